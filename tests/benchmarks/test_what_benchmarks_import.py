# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Each benchmark imports what the package has, though no type checker looks at them."""

from __future__ import annotations

import importlib
from pathlib import Path

import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.mark.parametrize("name", sorted(path.stem for path in BENCHMARKS.glob("*.py")))
def test_all_that_it_imports_is_there(name, monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    try:
        importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (BENCHMARKS / f"{error.name}.py").exists() or error.name.startswith("mnsf_ros"):
            raise
        pytest.skip(f"{error.name} is not installed")
