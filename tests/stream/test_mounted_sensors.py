# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Streams of lidars that are tilted, upside down or away from the origin: the same flow."""

from dataclasses import replace

import numpy as np
import pytest
from box_street import BoxStreet, pose
from scipy.spatial.transform import Rotation

from mnsf_ros.core.reason import Verdict
from mnsf_ros.geometry.transforms import tilt
from mnsf_ros.settings import Settings
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Sweep

SWEEPS = [
    BoxStreet().sweep(
        pose(x=0.5 * number), number, odometry=pose(x=0.5 * number), cars=[(9.0 + number, 2.0)]
    )
    for number in range(6)
]
BY_ODOMETRY = {"ego_motion.source": "odometry"}


def frame(roll_deg, pitch_deg, shift):
    """(4, 4) sensor_from_level."""
    result = np.eye(4)
    turn = Rotation.from_euler("YX", (pitch_deg, roll_deg), degrees=True)
    result[:3, :3], result[:3, 3] = turn.as_matrix().T, shift
    return result


def seen_in(sweep, sensor_from_level):
    xyz = sweep.xyz @ sensor_from_level[:3, :3].T + sensor_from_level[:3, 3]
    odometry = sweep.odometry @ np.linalg.inv(sensor_from_level)
    return replace(sweep, xyz=xyz.astype(np.float32), odometry=odometry)


def estimates(sweeps, changes):
    stream = Stream(Settings().changed(changes))
    return [found for sweep in sweeps if (found := stream.push(sweep)) is not None], stream


@pytest.fixture(scope="module")
def level():
    return {
        source: estimates(SWEEPS, {"ego_motion.source": source})[0][-1]
        for source in ("registration", "odometry")
    }


@pytest.mark.parametrize("source", ["registration", "odometry"])
@pytest.mark.parametrize(
    ("mount", "changes"),
    [
        ((180.0, 0.0, (0.0, 0.0, 0.0)), {}),
        ((180.0, 0.0, (0.0, 0.0, 0.0)), {"lidar_1.roll_deg": 180.0}),
        ((0.0, 45.0, (0.0, 0.0, 0.0)), {"lidar_1.pitch_deg": 45.0}),
        (
            (0.0, 0.0, (1.5, 0.0, 1.75)),
            {"lidars.frame": "lidar", "lidar_1.x_m": 1.5, "lidar_1.z_m": 1.75},
        ),
    ],
)
def test_the_estimate_is_as_level_in_the_frame_of_the_sensor(level, source, mount, changes):
    sensor_from_level, expected = frame(*mount), level[source]
    turn = sensor_from_level[:3, :3]
    sweeps = [seen_in(sweep, sensor_from_level) for sweep in SWEEPS]
    found, stream = estimates(sweeps, changes | {"ego_motion.source": source})
    found = found[-1]
    assert stream.triplet.current.xyz is sweeps[-2].xyz
    assert np.linalg.norm(found.flow - expected.flow @ turn.T, axis=1).mean() < 0.02
    known, level_known = found.over_ground, expected.over_ground
    assert np.mean(known.dynamic != level_known.dynamic) < 0.02
    dynamic = known.dynamic & level_known.dynamic
    assert dynamic.sum() > 100
    motion = level_known.motion[dynamic] @ turn.T
    assert np.linalg.norm(known.motion[dynamic] - motion, axis=1).mean() < 0.05
    # The world is the frame of the first sweep, and that of the sensor.
    level_from_sensor = np.linalg.inv(sensor_from_level)
    for name in ("world_from_sensor", "next_from_current"):
        own = sensor_from_level @ getattr(level_known, name) @ level_from_sensor
        np.testing.assert_allclose(getattr(known, name), own, atol=0.02)
    for name in ("pose_covariance", "motion_covariance"):
        volume = np.linalg.det(getattr(known, name)) / np.linalg.det(getattr(level_known, name))
        assert 0.3 < volume < 3.0
    (item,), (other,) = known.objects, level_known.objects
    center = sensor_from_level[:3, :3] @ other.center + sensor_from_level[:3, 3]
    np.testing.assert_allclose(item.center, center, atol=0.1)
    np.testing.assert_allclose(item.velocity, turn @ other.velocity, atol=0.6)
    np.testing.assert_allclose(item.size, other.size, atol=0.2)


def test_reasons_are_in_the_frame_of_the_sensor():
    sensor_from_level = frame(180.0, 0.0, (0.0, 0.0, 0.0))
    sweeps = [seen_in(sweep, sensor_from_level) for sweep in SWEEPS]
    found, stream = estimates(sweeps, {})
    rows = np.flatnonzero(found[-1].over_ground.dynamic)
    reason = found[-1].reason_of(rows)
    assert reason.verdict is Verdict.DYNAMIC
    assert reason.motion[0] == pytest.approx(1.0, abs=0.1)
    own = stream.triplet.current.xyz[rows]
    low, high = own.min(axis=0) - 0.5, own.max(axis=0) + 0.5
    for terms in reason.sweeps:
        assert (terms.static.positions > low).all()
        assert (terms.static.positions < high).all()


def test_the_mounting_is_told_before_and_after_the_first_cloud():
    stream = Stream(Settings())
    assert stream.mounting.text == "unknown: no cloud yet"
    stream.add(Sweep(np.ones((100, 3), np.float32), frame_id=SWEEPS[0].frame_id))
    assert stream.mounting.text == "unknown: no ground is seen"
    stream.add(SWEEPS[0])
    assert "estimated from the ground" in stream.mounting.text


def test_another_mounting_begins_anew():
    stream = Stream(Settings())
    for sweep in SWEEPS[:3]:
        stream.add(sweep)
    assert stream.triplet is not None
    stream.change_settings(stream.settings.changed({"lidar_1.roll_deg": 90.0}))
    assert stream.add(SWEEPS[3]).value == "frame_changed"
    assert stream.triplet is None


class Tilted:
    """The way of a robot, of which the lidar is pitched down."""

    def __init__(self, ego, pitch_deg):
        self._ego, self._pitched = ego, tilt(np.deg2rad(pitch_deg), 0.0)

    def world_from_sensor(self, time_s):
        return self._ego.world_from_sensor(time_s) @ self._pitched

    def __getattr__(self, name):
        return getattr(self._ego, name)


def test_what_leaves_the_slanting_view_of_a_tilted_lidar_does_not_move():
    """In the level frame the edges of its view cut walls aslant, and travel along with it."""
    simulator = SweepSimulator(
        SimulationSettings(seed=3, duration_s=1.6, num_beams=32, num_columns=900)
    )
    simulator.scene = replace(simulator.scene, ego=Tilted(simulator.scene.ego, 20.0))
    true = list(simulator)
    sweeps = [Sweep(one.xyz.astype(np.float32), one.truth.stamp_ns) for one in true]
    mounting = {"lidars.poses": "parameters", "lidar_1.pitch_deg": 20.0}
    found, _ = estimates(sweeps, mounting)
    called, moves = (
        np.concatenate(each)
        for each in (
            [one.over_ground.dynamic for one in found[5:]],
            [one.truth.dynamic for one in true[6:-1]],
        )
    )
    assert called[moves].mean() > 0.85
    assert np.count_nonzero(called & ~moves) < 0.01 * np.count_nonzero(moves)
