# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recordings of simulated streets, and the topics of a robot in them."""

from itertools import pairwise

import numpy as np
import pytest
from recorded_truth import read_sensor_poses, read_truth

from mnsf_ros.cli.main import run
from mnsf_ros.geometry.transforms import apply, invert, planar_pose, pose_matrix, transform_matrix
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


@pytest.fixture(scope="module")
def robot(tmp_path_factory):
    """The messages by topic of a recording for nav2, and its simulator."""
    path = tmp_path_factory.mktemp("robot") / "street.mcap"
    options = ("--scenario", "random", "--seed", "713", "--duration-s", "0.3")
    assert run(["simulate", str(path), "--nav2", *options]) == 0
    settings = SimulationSettings(seed=713, duration_s=0.3, scenario="random")
    with BagReader(path) as reader:
        return {topic: list(reader.messages(topic)) for topic in reader.topics}, SweepSimulator(
            settings
        )


def test_a_robot_knows_its_pose_by_tf_and_odometry(robot):
    messages, simulator = robot
    links, poses = {}, {}
    for message in messages["/tf"]:
        for one in message.transforms:
            link = one.header.frame_id, one.child_frame_id
            links[link, decode_stamp(one.header.stamp)] = transform_matrix(one.transform)
    for one in messages["/odom"]:
        assert (one.header.frame_id, one.child_frame_id) == ("odom", "base_link")
        poses[decode_stamp(one.header.stamp)] = pose_matrix(one.pose.pose), one.twist.twist
    assert len(poses) == 5 * simulator.num_sweeps
    for sweep in simulator:
        stamp_ns = sweep.truth.stamp_ns
        robot_pose = links[("odom", "base_link"), stamp_ns]
        lidar_pose = robot_pose @ links[("base_link", "lidar"), stamp_ns]
        np.testing.assert_allclose(lidar_pose, sweep.pose, atol=1e-9)
        np.testing.assert_allclose(poses[stamp_ns][0], robot_pose, atol=1e-9)
    stamps = sorted(poses)
    for before, after in pairwise(stamps):
        (pose, twist), elapsed_s = poses[before], (after - before) / 1e9
        step = (invert(pose) @ poses[after][0])[:3, 3] / elapsed_s
        assert [twist.linear.x, twist.linear.y] == pytest.approx(step[:2], abs=0.05)


def test_exact_tracks_are_those_of_the_points(robot):
    messages, simulator = robot
    speeds = []
    for number, (cloud, markers) in enumerate(
        zip(messages["/truth/objects"], messages["/truth/objects/markers"], strict=True)
    ):
        sweep, objects = simulator.sweep(number), decode_points(cloud).ravel()
        assert decode_stamp(cloud.header.stamp) == sweep.truth.stamp_ns
        assert len(markers.markers) == 1 + 3 * len(objects)
        known = {int(one["id"]): one for one in objects}
        moving = np.unique(sweep.truth.object_id[sweep.truth.dynamic])
        assert set(moving) <= set(known)
        for track_id in moving:
            one, own = known[int(track_id)], sweep.truth.object_id == track_id
            assert one["num_points"] == own.sum()
            pose = planar_pose(one["x"], one["y"], one["yaw"], one["z"])
            times_s = sweep.columns["t"][own, None] * 1e-9
            velocity = np.array([one["vx"], one["vy"], one["vz"]])
            at_stamp = sweep.xyz[own] - times_s * velocity
            inside = np.abs(apply(invert(pose), at_stamp))
            half = np.array([one["length"], one["width"], one["height"]]) / 2
            # Boxes are upright in the frame of the lidar, which is tilted and has noise.
            assert (inside < half + 0.5).all()
            assert (inside < half + 0.2).all(axis=1).mean() > 0.9
            speeds.append(float(np.linalg.norm(velocity)))
    assert max(speeds) > 5
