# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How long is searched: seconds in the tests, as long as is asked for with `make fuzz`."""

import os

import pytest

hypothesis = pytest.importorskip("hypothesis")

_NUM_EXAMPLES = int(os.environ.get("FUZZ_EXAMPLES", "0"))

hypothesis.settings.register_profile(
    "tests",
    max_examples=_NUM_EXAMPLES or 60,
    # Of the tests each run is the same; a long search goes its own way and remembers what it found.
    derandomize=not _NUM_EXAMPLES,
    deadline=None,
    suppress_health_check=list(hypothesis.HealthCheck),
)
hypothesis.settings.load_profile("tests")
