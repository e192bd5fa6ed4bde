# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A few of the damaged recordings that benchmarks/mutated_bags.py makes by the thousand."""

import importlib
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def mutated_bags(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("mutated_bags")


@pytest.mark.slow
def test_no_crash_no_hang_and_no_wrong_number_in_silence(mutated_bags, tmp_path, monkeypatch):
    monkeypatch.setattr(mutated_bags, "LIMIT_S", 300)
    rounds = ((number, np.random.default_rng([7, number])) for number in range(90))
    by_format, bad = mutated_bags.run(rounds, tmp_path)
    assert bad == []
    assert len(by_format) == 8
    verdicts = sum(by_format.values(), start=type(by_format["mcap"])())
    assert verdicts.total() == 90
    # The damage is real: not everything goes through unnoticed, nor is everything refused.
    assert verdicts["same"] > 3
    assert verdicts["partial"] > 3
    assert verdicts["refused"] > 3
    # Where a pose is lost, that of `ego` is extrapolated, with a warning.
    for name in ("mcap checked", "mcap zstd checked", "mcap lz4 checked"):
        assert by_format[name]["unprotected"] == 0
