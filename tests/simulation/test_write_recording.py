# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from itertools import pairwise

import numpy as np
import pytest
from recorded_truth import read_sensor_poses, read_truth
from scipy.spatial.transform import Rotation

from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator, write_recording
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import decode_stamp

SETTINGS = SimulationSettings(seed=2, duration_s=0.2, num_beams=16, num_columns=90)
# A random world whose lidar turns.
ROLLING = SimulationSettings(seed=3, duration_s=0.2, scenario="random")


def files_of(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize("settings", [SETTINGS, ROLLING])
def test_recording_holds_what_was_simulated(tmp_path, settings):
    calls = []
    write_recording(settings, tmp_path / "street", lambda *p: calls.append(p))
    assert calls == [(1, 2), (2, 2)]
    sweeps = list(SweepSimulator(settings))
    with BagReader(tmp_path / "street") as reader:
        truth = read_truth(reader)
        poses = read_sensor_poses(reader)
        assert list(truth) == list(poses) == [sweep.truth.stamp_ns for sweep in sweeps]
        for sweep, message in zip(sweeps, reader.messages("/points"), strict=True):
            true = sweep.truth
            assert decode_stamp(message.header.stamp) == true.stamp_ns
            assert message.header.frame_id == "lidar"
            points = decode_points(message).ravel()
            has_times = settings is ROLLING
            assert points.dtype.names == (*"xyz", "intensity", "ring", *(["t"] * has_times))
            assert np.array_equal(np.stack([points[a] for a in "xyz"], axis=1), sweep.xyz)
            for name, column in sweep.columns.items():
                assert np.array_equal(points[name], column), name
            found = truth[true.stamp_ns]
            for name in ("dynamic", "ground", "class_id", "object_id"):
                assert np.array_equal(getattr(found, name), getattr(true, name)), name
            assert np.allclose(poses[true.stamp_ns], sweep.pose, atol=1e-9)
            if sweep is sweeps[-1]:
                assert not found.valid.any()
                assert np.isnan(found.flow).all()
            else:
                assert found.valid.all()
                assert np.array_equal(found.flow, true.flow)


def test_equal_settings_give_equal_bytes(tmp_path):
    for parent in ("a", "b"):
        write_recording(SETTINGS, tmp_path / parent / "street")
    first, second = (files_of(tmp_path / parent / "street") for parent in "ab")
    assert first == second


def test_the_imu_measures_how_the_lidar_turns(tmp_path):
    settings = SimulationSettings(seed=5, duration_s=0.4, scenario="turns", imu_hz=400.0)
    simulator = write_recording(settings, tmp_path / "turns.mcap")
    with BagReader(tmp_path / "turns.mcap") as reader:
        times = [stamp_ns for stamp_ns, _ in reader.raw_messages("/imu")]
        found = [message.angular_velocity for message in reader.messages("/imu")]
        first_ns = next(reader.raw_messages("/points"))[0]
    assert np.all(np.diff(times) == 2_500_000)
    assert times[0] < first_ns < first_ns + 400_000_000 < times[-1]
    rates = np.array([[rate.x, rate.y, rate.z] for rate in found])
    turns = [
        simulator.scene.ego.world_from_sensor((stamp_ns - first_ns) / 1e9)[:3, :3]
        for stamp_ns in times
    ]
    true = Rotation.from_matrix([a.T @ b for a, b in pairwise(turns)]).as_rotvec() / 0.0025
    # But for their bias, by 3 % and noise.
    off = (rates[1:] + rates[:-1]) / 2 - true
    assert np.abs(off).max() < np.radians(20.0) + 0.03 * np.abs(true).max() + 0.01
    varying = np.abs(off - off.mean(axis=0)).max()
    assert varying < 0.03 * np.ptp(true, axis=0).max() + np.radians(0.4)
