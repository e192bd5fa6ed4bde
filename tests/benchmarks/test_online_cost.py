# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Verdicts on differences that scatter."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")


ROOT = Path(__file__).parents[2]


@pytest.fixture
def share_row(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module("online_cost").share_row


@pytest.mark.parametrize(
    ("part_ms", "whole_ms", "share", "verdict"),
    [
        ((5, 6, 4), (20, 21, 19), "0.25", "met"),
        ((0, 0.4, -0.4), (20, 20.4, 19.6), "0.00", "met"),
        ((16, 17, 15), (20, 21, 19), "0.80", "MISSED"),
        ((-5, -20, 25), (20, 21, 19), "-5 of 20 ms", "noise"),
        ((-10, -4, -16), (8, 14, 2), "-10 of 8 ms", "noise"),
        ((9, 11, 7), (20, 24, 16), "0.45", "noise"),
        ((2, 3, 1), (-3, 40, -30), "2 of -3 ms", "noise"),
    ],
)
def test_what_scatters_too_much_is_called_noise(share_row, part_ms, whole_ms, share, verdict):
    row = share_row("share", np.array(part_ms, float), np.array(whole_ms, float))
    assert row[2].startswith(share)
    assert row[3] == verdict


def test_each_part_of_the_targets_has_a_section(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    targets = importlib.import_module("online_targets")
    read_section = importlib.import_module("marked_section").read_section
    for part in targets.PARTS:
        text = read_section(ROOT / "docs" / "performance.md", targets.section_of(part))
        assert "| :--- |" in text
