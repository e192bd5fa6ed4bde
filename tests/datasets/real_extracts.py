# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Where extracts of real data sets lie, if they do."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[3] / "shared" / "data"))


def extract(name):
    folder = DATA / name
    if not folder.is_dir():
        pytest.skip(f"{folder} is not there")
    return folder
