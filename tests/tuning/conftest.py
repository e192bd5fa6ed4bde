# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A street of two seconds, simulated once."""

import pytest


@pytest.fixture(scope="session")
def street(make_street):
    return make_street(seed=3, duration_s=1.8, num_columns=512)
