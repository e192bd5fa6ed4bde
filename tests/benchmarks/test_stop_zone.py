# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script that measures how moving points stop a robot, and that they do."""

from __future__ import annotations

import importlib
from pathlib import Path

import numpy as np
import pytest
import yaml

from mnsf_ros.simulation.settings import SimulationSettings

ROOT = Path(__file__).parents[2]


@pytest.fixture
def stop_zone(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    return importlib.import_module("stop_zone")


def watched(stop_zone, true, said):
    times_s = np.arange(len(true)) / 10
    return stop_zone.Watched(times_s, 20 * np.array(true), 20 * np.array(said), 0.0)


def test_figures_of_a_stop_that_is_late_and_interrupted(stop_zone):
    #             0  1  2  3  4  5  6  7  8  9  10 ...
    true = [0, 0, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    said = [0, 0, 0, 1, 1, 1, 1, 0, 1, 1, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    late_s, held, after_s, false = stop_zone.figures(watched(stop_zone, true, said), 0.1).values()
    assert late_s == pytest.approx(0.2, abs=0.02)
    assert held == pytest.approx(100 * 7 / 8, abs=2)
    assert after_s == pytest.approx(0.1, abs=0.02)
    assert false == 0.0


def test_stops_for_nothing_and_none_at_all(stop_zone):
    true = [0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]
    said = [0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 0, 0, 0, 0, 0, 0, 0, 0]
    late_s, held, _, false = stop_zone.figures(watched(stop_zone, true, said), 0.1).values()
    assert (late_s, held) == (np.inf, 0.0)
    assert 10 < false < 25


def test_a_crossing_pedestrian_stops_the_robot(stop_zone):
    settings = SimulationSettings(
        duration_s=5.5, num_beams=32, num_columns=512, ego_speed_m_s=0.0, scenario="crossing"
    )
    found = stop_zone.figures(stop_zone.watch(settings), 0.2)
    missed = {
        name: value
        for name, value in found.items()
        if (value < stop_zone.LIMITS[name] if "held" in name else value > stop_zone.LIMITS[name])
    }
    assert missed == {}


def test_the_recipe_has_the_box_that_was_measured(stop_zone):
    blocks = (ROOT / "docs" / "recipes.md").read_text().split("```yaml\n")[1:]
    parameters = yaml.safe_load(blocks[0].partition("```")[0])["collision_monitor"]
    polygon = parameters["ros__parameters"]["stop_for_movers"]
    corners = np.array(yaml.safe_load(polygon["points"]))
    np.testing.assert_array_equal(corners.min(axis=0), stop_zone.LOW[:2])
    np.testing.assert_array_equal(corners.max(axis=0), stop_zone.HIGH[:2])
    assert polygon["min_points"] == stop_zone.MIN_POINTS
    for block in blocks:
        yaml.safe_load(block.partition("```")[0])
