# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A few of the damaged recordings that benchmarks/mutated_bags.py makes by the thousand."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"


@pytest.fixture
def mutated_bags(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module("mutated_bags")


def test_no_crash_no_hang_and_no_wrong_number_in_silence(mutated_bags, tmp_path, monkeypatch):
    monkeypatch.setattr(mutated_bags, "LIMIT_S", 300)
    by_format, bad = mutated_bags.run(range(45), 7, tmp_path)
    assert bad == []
    assert len(by_format) == 9
    verdicts = sum(by_format.values(), start=type(by_format["mcap"])())
    assert verdicts.total() == 45
    # The damage is real: not everything goes through unnoticed, nor is everything refused.
    assert verdicts["same"] > 3
    assert verdicts["partial"] > 3
    assert verdicts["refused"] > 3
    for name in ("mcap checked", "mcap zstd checked", "mcap lz4 checked"):
        assert by_format[name]["unprotected"] == by_format[name]["warned"] == 0


def test_every_mutation_changes_the_data(mutated_bags):
    data = bytes(range(256)) * 40
    for seed in range(200):
        damaged, kind = mutated_bags.mutated(data, np.random.default_rng(seed))
        assert kind in mutated_bags.DAMAGES
        assert damaged != data or kind in ("move", "length", "zero", "flip", "flip at end")


@pytest.mark.parametrize(
    ("errors", "is_warned", "has_checksums", "verdict"),
    [
        (1.0, False, True, "same"),
        (1.0, True, True, "same"),
        (2.0, True, True, "warned"),
        (2.0, False, False, "unprotected"),
        (2.0, False, True, "silent"),
        (None, True, True, "partial"),
        (None, False, True, "silent"),
    ],
)
def test_verdicts(mutated_bags, monkeypatch, tmp_path, errors, is_warned, has_checksums, verdict):
    rows = {} if errors is None else {("ego", 1): {"errors": errors}}
    monkeypatch.setattr(mutated_bags, "evaluate", lambda path: (rows, is_warned, has_checksums))
    expected = {("ego", 1): {"errors": 1.0}}
    assert mutated_bags.judge(tmp_path, expected)[0] == verdict


def test_crashes_and_hangs_are_found(mutated_bags, monkeypatch, tmp_path):
    def crash(path):
        raise KeyError(path)

    monkeypatch.setattr(mutated_bags, "evaluate", crash)
    assert mutated_bags.judge(tmp_path, {})[0] == "crash"

    def hang(path):
        while True:
            pass

    monkeypatch.setattr(mutated_bags, "LIMIT_S", 1)
    monkeypatch.setattr(mutated_bags, "evaluate", hang)
    assert mutated_bags.judge(tmp_path, {})[0] == "hang"
