# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import itertools

import numpy as np
import pytest
from slow_geometry import corners, overlap

from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.routes import EGO_LENGTH_M, EGO_WIDTH_M
from mnsf_ros.simulation.scene import build_scene
from mnsf_ros.simulation.settings import SimulationSettings

DURATION_S = 10.0
TIMES = np.arange(0.0, DURATION_S + 0.15, 0.1)


def tracks(scene):
    """Name and (T, 4, 2) corners of everything that moves, the ego vehicle first."""
    found = [("ego", corners(scene.ego.trip.planar(TIMES), EGO_LENGTH_M, EGO_WIDTH_M))]
    for number, body in enumerate(scene.bodies):
        if body.trip is not None:
            model = body.model
            name = f"{model.surface_class.name} {number}"
            found.append((name, corners(body.trip.planar(TIMES), model.length_m, model.width_m)))
    return found


def apart(one, other):
    return np.any(one.min((0, 1)) > other.max((0, 1))) or np.any(
        other.min((0, 1)) > one.max((0, 1))
    )


@pytest.mark.parametrize(("seed", "speed"), [(0, 8.0), (6, 8.0), (7, 8.0), (3, 0.0), (1, 12.0)])
def test_nothing_moving_touches_anything(seed, speed):
    scene = build_scene(SimulationSettings(seed=seed, ego_speed_m_s=speed, duration_s=DURATION_S))
    moving = tracks(scene)
    assert len(moving) > 20
    for (name, one), (other_name, other) in itertools.combinations(moving, 2):
        if not apart(one, other):
            assert not overlap(one, other).any(), (name, other_name)
    for body in scene.bodies:
        if body.trip is None:
            pose, model = body.placement, body.model
            yaw = np.arctan2(pose[1, 0], pose[0, 0])
            still = corners(np.array([[*pose[:2, 3], yaw]]), model.length_m, model.width_m)
            for name, one in moving:
                if not apart(one, still):
                    still_often = np.broadcast_to(still, one.shape)
                    assert not overlap(one, still_often).any(), (name, model.surface_class)


@pytest.mark.parametrize("seed", range(8))
def test_traffic_is_varied(seed):
    scene = build_scene(SimulationSettings(seed=seed, duration_s=DURATION_S))
    ego = scene.ego.trip.planar(TIMES)
    kinds, with_ego, against, across, turning = set(), 0, 0, 0, 0
    for body in scene.bodies:
        if body.trip is None:
            continue
        kinds.add(body.model.surface_class)
        if body.model.surface_class is not SurfaceClass.CAR:
            continue
        poses = body.trip.planar(TIMES)
        near = np.linalg.norm(poses[:, :2] - ego[:, :2], axis=1) < 60.0
        relative = np.cos(poses[near, 2] - ego[near, 2])
        with_ego += bool(np.any(relative > 0.9))
        against += bool(np.any(relative < -0.9))
        across += bool(np.any(np.abs(relative) < 0.2))
        turning += bool(np.ptp(poses[near, 2]) > 1.0) if near.any() else 0
    assert kinds == {SurfaceClass.CAR, SurfaceClass.PEDESTRIAN, SurfaceClass.CYCLIST}
    assert with_ego >= 1
    assert against >= 2
    assert across >= 1
    assert across + turning >= 2


def test_ego_vehicle_drives_waits_and_turns():
    trip = build_scene(SimulationSettings(duration_s=DURATION_S)).ego.trip
    poses = trip.planar(TIMES)
    speed = np.linalg.norm(np.diff(poses[:, :2], axis=0), axis=1) / 0.1
    assert speed.max() == pytest.approx(8.0, abs=0.05)
    assert (speed < 0.05).sum() >= 8
    assert 0.02 < np.ptp(poses[:, 2]) < 0.8
    assert np.abs(np.diff(speed)).max() / 0.1 < 4.0
