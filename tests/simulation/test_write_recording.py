# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest
from recorded_truth import read_sensor_poses, read_truth

from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import decode_stamp

SETTINGS = SimulationSettings(seed=2, duration_s=0.2, num_beams=16, num_columns=90)
# A random world whose lidar turns.
ROLLING = SimulationSettings(seed=3, duration_s=0.2, scenario="random")


def files_of(folder):
    return {file.name: file.read_bytes() for file in folder.iterdir()}


@pytest.mark.parametrize(("settings", "compress"), [(SETTINGS, True), (ROLLING, False)])
def test_recording_holds_what_was_simulated(tmp_path, settings, compress):
    calls = []
    write_recording(settings, tmp_path / "street", lambda *p: calls.append(p), compress=compress)
    assert calls == [(1, 2), (2, 2)]
    sweeps = list(SweepSimulator(settings))
    with BagReader(tmp_path / "street") as reader:
        truth = read_truth(reader)
        poses = read_sensor_poses(reader)
        assert list(truth) == list(poses) == [sweep.stamp_ns for sweep in sweeps]
        for sweep, message in zip(sweeps, reader.messages("/points"), strict=True):
            assert decode_stamp(message.header.stamp) == sweep.stamp_ns
            assert message.header.frame_id == "lidar"
            points = decode_points(message).ravel()
            has_times = sweep.times_ns is not None
            names = ("x", "y", "z", "intensity", "ring", *(["t"] if has_times else []))
            assert points.dtype.names == names
            assert not has_times or np.array_equal(points["t"], sweep.times_ns)
            assert np.array_equal(np.stack([points[a] for a in "xyz"], axis=1), sweep.xyz)
            assert np.array_equal(points["ring"], sweep.ring)
            assert np.array_equal(points["intensity"], sweep.intensity)
            found = truth[sweep.stamp_ns]
            assert np.array_equal(found.object_id, sweep.body + 1)
            for name in ("dynamic", "ground", "class_id"):
                assert np.array_equal(getattr(found, name), getattr(sweep, name)), name
            assert np.allclose(poses[sweep.stamp_ns], sweep.world_from_sensor, atol=1e-9)
            if sweep is sweeps[-1]:
                assert not found.valid.any()
                assert np.isnan(found.flow).all()
            else:
                assert found.valid.all()
                assert np.array_equal(found.flow, sweep.flow)


def test_equal_settings_give_equal_bytes(tmp_path):
    for parent in ("a", "b"):
        write_recording(SETTINGS, tmp_path / parent / "street")
    first, second = (files_of(tmp_path / parent / "street") for parent in "ab")
    assert first == second
