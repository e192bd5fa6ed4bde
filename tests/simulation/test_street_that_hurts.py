# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from slow_geometry import corners, overlap

from mnsf_ros.simulation.bodies import SurfaceClass
from mnsf_ros.simulation.scene import build_scene
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator

SETTINGS = SimulationSettings(seed=1, duration_s=4.0, scenario="street_that_hurts")
TIMES = np.arange(0.0, 4.0, 0.2)


@pytest.fixture(scope="module")
def scene():
    return build_scene(SETTINGS)


def walks(scene):
    """(T, 3) poses of all people."""
    return [
        body.trip.planar(TIMES)
        for body in scene.bodies
        if body.trip is not None and body.model.surface_class is SurfaceClass.PEDESTRIAN
    ]


def speeds(poses):
    return np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) / 0.2


def test_the_roadside_is_that_of_the_usual_street(scene):
    usual = build_scene(replace(SETTINGS, scenario="street"))
    placements = [
        [body.placement for body in each.bodies if body.trip is None] for each in (scene, usual)
    ]
    assert np.array_equal(*placements)


def test_equal_seeds_give_equal_sweeps():
    small = replace(SETTINGS, num_beams=16, num_columns=90)
    one, other = (SweepSimulator(small).sweep(3) for _ in range(2))
    assert np.array_equal(one.xyz, other.xyz)
    assert np.array_equal(one.body, other.body)


def test_movers_keep_clear_of_each_other(scene):
    movers = [body for body in scene.bodies if body.trip is not None]
    places = [
        corners(body.trip.planar(TIMES), body.model.length_m, body.model.width_m) for body in movers
    ]
    for one, other in itertools.combinations(places, 2):
        assert not overlap(one, other).any()


def test_people_walk_slowly_and_stop(scene):
    found = [speeds(poses) for poses in walks(scene)]
    assert sum(each.max() < 1.0 for each in found) >= 3
    assert sum(each.min() < 0.05 and each.max() > 0.3 for each in found) >= 3


def test_people_walk_along_walls_and_step_out_between_parked_cars(scene):
    lateral = [
        np.abs(scene.street.centerline.lateral(poses[:, 0], poses[:, 1])) for poses in walks(scene)
    ]
    assert sum(each.min() > 10.0 for each in lateral) >= 3
    assert sum(np.ptp(each) > 1.0 for each in lateral) >= 2


def test_a_lorry_drives_alongside_with_odd_seeds(scene):
    lorries = [b for b in scene.bodies if b.model.surface_class is SurfaceClass.LARGE_VEHICLE]
    assert len(lorries) == 1
    apart = lorries[0].trip.planar(TIMES)[:, :2] - scene.ego.trip.planar(TIMES)[:, :2]
    assert np.linalg.norm(apart, axis=1).max() < 10.0
    even = build_scene(replace(SETTINGS, seed=2))
    assert SurfaceClass.LARGE_VEHICLE not in {body.model.surface_class for body in even.bodies}


def test_scooters_overtake(scene):
    fast = [
        body
        for body in scene.bodies
        if body.trip is not None
        and body.model.surface_class is SurfaceClass.CYCLIST
        and speeds(body.trip.planar(TIMES)).max() > 7.0
    ]
    assert len(fast) >= 2
