# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The benchmarks, which are scripts beside the package, as modules."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest


@pytest.fixture
def load(monkeypatch):
    """Imports a benchmark by its name."""
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module
