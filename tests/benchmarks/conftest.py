# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The benchmarks, which are scripts beside the package, as modules."""

import importlib
from pathlib import Path

import pytest


@pytest.fixture(scope="module")
def load():
    """Imports a benchmark by its name."""
    with pytest.MonkeyPatch.context() as patch:
        patch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
        yield importlib.import_module
