# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Places of movers that were written down by eye."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest


@pytest.fixture
def by_eye(monkeypatch):
    monkeypatch.syspath_prepend(str(Path(__file__).parents[2] / "benchmarks"))
    return importlib.import_module("movers_by_eye")


def test_a_place_is_on_a_mover_where_that_is_in_this_sweep(by_eye):
    walker = by_eye.Mover(5, np.array([1.0, 0.5]), np.array([[0.0, 0.0], [2.0, 0.0]]))
    places = np.array([[0.9, 0.0], [2.9, 0.4], [2.0, 0.6]])
    assert walker.holds(places, 5).tolist() == [True, False, False]
    assert walker.holds(places, 6).tolist() == [False, True, False]


def test_all_places_can_be_read(by_eye):
    for drive in by_eye.DRIVES:
        movers = by_eye.Eyes(drive).movers
        assert {each.xy_m.shape[1:] for each in movers} == {(2,)}
        assert all(each.first >= 0 and (each.half_m > 0).all() for each in movers)
