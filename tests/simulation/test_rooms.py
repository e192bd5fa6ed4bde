# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Simulated rooms, lidars in the hand, standing starts and directions that stay the same."""

from dataclasses import replace

import numpy as np
import pytest

from mnsf_ros.geometry.transforms import apply
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.settings import INDOORS, SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator

SEEDS = range(8)
STREET = SimulationSettings(seed=1, num_beams=16, num_columns=300, stands_s=1.0)
ROOMS = SimulationSettings(3, scenario="rooms", stands_s=1.0)
TIMES_S = np.arange(0.0, 10.0, 0.1)


def rooms(seed, scenario="rooms", **settings):
    return SweepSimulator(SimulationSettings(seed, scenario=scenario, **settings))


def directions(simulator, index):
    """Directions of the points of a sweep."""
    xyz = simulator.sweep(index).xyz
    return xyz / np.linalg.norm(xyz, axis=1, keepdims=True)


@pytest.mark.parametrize("scenario", INDOORS)
@pytest.mark.parametrize("seed", SEEDS[:4])
def test_all_is_between_floor_and_ceiling(scenario, seed):
    simulator = rooms(seed, scenario)
    sweep = simulator.sweep(20)
    rolling = sweep.columns.get("t", np.zeros(len(sweep.xyz)))
    first = rolling == rolling.min()
    ego = simulator.scene.ego.world_from_sensor(2.0 + rolling.min() * 1e-9)
    height_m = apply(ego, sweep.xyz[first].astype(float))[:, 2]
    assert -0.1 < height_m.min() < height_m.max() < 6.1
    assert len(sweep.xyz) > 0.9 * simulator.scene.sensor.num_columns * 16
    assert np.median(np.linalg.norm(sweep.xyz, axis=1)) < 10.0


@pytest.mark.parametrize("scenario", INDOORS)
def test_rooms_differ_as_declared(scenario):
    scenes = [rooms(seed, scenario).scene for seed in range(20)]
    speeds = [scene.ego.trip.profile.speeds_m_s[-1] for scene in scenes]
    heights_m = np.array([scene.ego.mounting[2] for scene in scenes])
    assert 0.5 <= min(speeds) < 0.9 < max(speeds) <= 1.5
    assert 0.3 <= heights_m.min() < heights_m.max() <= 1.5
    views = {abs(scene.sensor.elevations_deg[0]) for scene in scenes}
    assert views == {15.0, 25.0, 45.0}
    classes = {body.model.surface_class for scene in scenes for body in scene.bodies}
    assert classes == {SurfaceClass.BUILDING, SurfaceClass.PEDESTRIAN}
    turned_deg = [np.degrees(largest_turn(scene.ego)) for scene in scenes]
    if scenario == "carried":
        assert 2.0 < min(turned_deg) < 30.0 < max(turned_deg) <= 62.0
    else:
        assert max(turned_deg) < 10.0


def largest_turn(ego):
    """Largest turn within a sweep, radians."""
    ahead = np.array([ego.world_from_sensor(time_s)[:2, 0] for time_s in TIMES_S])
    return np.abs(np.diff(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0])))).max()


@pytest.mark.parametrize("seed", SEEDS)
def test_nothing_is_in_the_way_of_the_robot(seed):
    """The nearest return is as far away as things keep from the way, or half a doorway."""
    simulator = rooms(seed)
    scene = simulator.scene
    simulator.scene = replace(scene, sensor=replace(scene.sensor, min_range_m=0.05))
    for index in (0, 25, 50, 75):
        assert np.linalg.norm(simulator.sweep(index).xyz[:, :2], axis=1).min() > 0.35


@pytest.mark.parametrize(
    "settings", [STREET, SimulationSettings(3, scenario="rooms", stands_s=1.0)]
)
def test_a_standing_start_stands_and_then_drives(settings):
    simulator = SweepSimulator(settings)
    trip = simulator.scene.ego.trip
    places = trip.planar(TIMES_S)[:, :2]
    steps_m = np.linalg.norm(np.diff(places, axis=0), axis=1)
    speed_m_s = trip.profile.speeds_m_s[-1]
    assert steps_m[:10].max() == 0.0 < steps_m[11]
    assert steps_m[40:] == pytest.approx(0.1 * speed_m_s, rel=0.02)


def test_fixed_directions_are_the_same_in_each_sweep():
    for is_fixed, kind in ((True, "fixed"), (False, "changing")):
        simulator = SweepSimulator(replace(STREET, directions=kind))
        azimuth = [
            np.unique(np.degrees(np.arctan2(each[:, 1], each[:, 0])).round(2) % 360)
            for each in (directions(simulator, index) for index in (0, 1))
        ]
        shared = np.intersect1d(*azimuth).size / azimuth[0].size
        assert (shared > 0.5) == is_fixed


@pytest.mark.parametrize(
    ("scenario", "points", "dynamic", "mean_m", "flow_m"),
    [
        ("street", 117056, 13089, 5.787942, 0.299817),
        ("random", 41687, 534, 6.7084, 0.376191),
        ("adverse", 36298, 502, 5.054371, 0.371593),
        ("standing", 40495, 0, 7.47341, 0.376843),
        ("turns", 41082, 749, 7.755644, 0.163486),
    ],
)
def test_older_scenarios_stay_what_they_are(scenario, points, dynamic, mean_m, flow_m):
    sweep = SweepSimulator(SimulationSettings(2, scenario=scenario)).sweep(3)
    assert (len(sweep.xyz), sweep.truth.dynamic.sum()) == (points, dynamic)
    figures = [np.abs(each.astype(float)).mean() for each in (sweep.xyz, sweep.truth.flow)]
    assert figures == pytest.approx([mean_m, flow_m], abs=1e-5)
