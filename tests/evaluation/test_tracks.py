# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Truth and poses that are read along with the sweeps."""

import struct
from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small
from bag_messages import cloud_cdr, cloud_message
from rosbags.typesys.stores import ros2_jazzy as ros

from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.evaluation.tracks import recorded_poses, recorded_sweeps
from mnsf_ros.evaluation.truth_track import TruthCloud, TruthTrack, truth_clouds
from mnsf_ros.geometry.pose_track import PoseTrack
from mnsf_ros.geometry.transforms import pose_quaternion, sensor_mount
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TF_TYPE, jazzy, used_topics
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.settings import EgoMotionSettings, Settings
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import encode_columns


def cloud(index, num_points=60):
    encoded = small.truth(index, num_points).encode(small.xyz(index, num_points))
    return cloud_message(encoded, small.stamp(index), "lidar", is_dense=False)


def truth_track(indices):
    clouds = (TruthCloud(small.stamp(index), cloud(index)) for index in indices)
    return TruthTrack(clouds, Findings(), "drive")


def take(track, index):
    truth, num_skipped = track.take(small.sweep(index))
    return None if truth is None else truth.stamp_ns, num_skipped


@pytest.mark.parametrize("wrong", [3, -5000])
def test_one_sweep_with_a_wrong_stamp_does_not_cost_the_others_their_truth(wrong):
    track = truth_track(range(40))
    for index in range(10):
        take(track, index)
    assert take(track, wrong) == (None, 0)
    found = [take(track, index)[0] for index in range(10, 40)]
    assert found[5:] == [small.stamp(index) for index in range(15, 40)]


def test_poses_of_the_robot_become_those_of_the_sensor_mounted_on_it(tmp_path):
    path = small.write_recording(tmp_path / "drive", 3)
    mount = EgoMotionSettings(sensor_x_m=1.5, sensor_z_m=2.0, sensor_yaw_deg=90.0)
    with BagReader(path) as reader:
        poses = list(recorded_poses(reader, "/truth/odometry", "odom", Findings()))
    track = PoseTrack(poses, sensor_mount(mount))
    of_sensor = [track.pose_at(small.stamp(index)) for index in range(3)]
    mounted = [[0, -1, 0, 1.5], [1, 0, 0, 0], [0, 0, 1, 2.0], [0, 0, 0, 1]]
    for index, (pose, sensor) in enumerate(zip(poses, of_sensor, strict=True)):
        assert (pose.stamp_ns, pose.frame_id, sensor.frame_id) == (small.stamp(index), "lidar", "")
        assert np.allclose(pose.world_from_frame, small.pose(index))
        assert np.allclose(sensor.world_from_frame, small.pose(index) @ mounted)


@pytest.mark.parametrize(
    ("off_ns", "is_used"), [(-400_000, True), (400_000, True), (600_000, False)]
)
def test_truth_whose_stamp_is_rounded_is_that_of_its_sweep(off_ns, is_used):
    clouds = [TruthCloud(small.stamp(index) + off_ns, cloud(index)) for index in range(4)]
    track = TruthTrack(clouds, Findings(), "drive")
    for index in range(4):
        assert (take(track, index)[0] is not None) == is_used


def moved(offset_m, rows=slice(None), *, invalid=()):
    """Truth of sweep 0 that says its points were somewhere else."""
    points, truth = small.xyz(0), small.truth(0)
    points[rows] += np.float32(offset_m)
    truth.valid[list(invalid)] = False
    return cloud_message(truth.encode(points), small.stamp(0), "lidar", is_dense=False)


def matched(message, sweep=None):
    """The truth that a sweep gets of a message, and the damage found in it."""
    findings = Findings()
    track = TruthTrack([TruthCloud(small.stamp(0), message)], findings, "drive")
    truth, _ = track.take(sweep or small.sweep(0))
    damages = [str(damage) for damage in findings.damages]
    assert findings.counts[Event.TRUTH_UNFIT] == len(damages) == (truth is None)
    return truth, "".join(damages)


@pytest.mark.parametrize("offset_m", [np.nan, 5.0])
def test_row_that_is_not_valid_need_not_say_where_it_is(offset_m):
    truth, _ = matched(moved(offset_m, [3, 8], invalid=[3, 8]))
    assert truth is not None


def with_several_values(name):
    message = cloud(0)
    message.fields = [replace(one, count=3 if one.name == name else 1) for one in message.fields]
    return message


def with_first_x(data):
    message = cloud(0)
    message.data[:4] = np.frombuffer(data, np.uint8)
    return message


def other_order(num_points=60):
    """Truth of more points, the last first."""
    encoded = small.truth(0, num_points)
    encoded = encoded.of_points(np.arange(num_points)[::-1])
    points = small.xyz(0, num_points)[::-1]
    return cloud_message(encoded.encode(points), small.stamp(0), "lidar", is_dense=False)


def without_positions(num_points):
    truth = small.truth(0, num_points)
    columns = {f"flow_{axis}": truth.flow[:, index] for index, axis in enumerate("xyz")}
    columns |= {
        name: getattr(truth, name).astype(np.uint8)
        for name in ("valid", "dynamic", "ground", "class_id")
    }
    encoded = encode_columns(columns, 1, num_points)
    return cloud_message(encoded, small.stamp(0), "lidar", is_dense=False)


@pytest.mark.parametrize("rows", [[3], [3, 8, 11, 40, 41, 59]])
@pytest.mark.parametrize("order", [1, -1])
def test_points_that_a_codec_moved_have_no_truth(rows, order):
    points, truth = small.xyz(0), small.truth(0)
    points[rows] += np.float32(0.01)
    encoded = truth.of_points(np.arange(60)[::order]).encode(points[::order])
    message = cloud_message(encoded, small.stamp(0), "lidar", is_dense=False)
    findings = Findings()
    found, _ = TruthTrack([TruthCloud(small.stamp(0), message)], findings, "drive").take(
        small.sweep(0)
    )
    assert np.flatnonzero(~found.valid).tolist() == rows
    np.testing.assert_array_equal(found.flow[found.valid], truth.flow[found.valid])
    reordered = {Event.TRUTH_REORDERED: 1} if order < 0 else {}
    assert findings.counts == reordered | {
        Event.TRUTH_ROWS_UNFIT: len(rows),
        Event.TRUTH_ROWS_COMPARED: 60,
    }
    assert not findings.damages


@pytest.mark.parametrize("num_points", [60, 75])
def test_truth_in_another_order_is_found_by_position(num_points):
    truth, _ = matched(other_order(num_points))
    np.testing.assert_array_equal(truth.flow, small.truth(0).flow)
    assert truth.valid.all()


_ELSEWHERE = "{} of 60 points have another position than in their truth, in any order".format


@pytest.mark.parametrize(
    ("message", "text"),
    [
        (moved(0.0005), ""),
        (moved(0.01), _ELSEWHERE(60)),
        (moved(0.01, slice(7)), _ELSEWHERE(7)),
        (moved(np.nan), "no row of the truth has a finite position"),
        # Flipped bits: a signaling NaN, and the largest number there is.
        (with_first_x(b"\x01\x00\x80\x7f"), ""),
        (with_first_x(b"\xff\xff\x7f\x7f"), ""),
        (cloud(0, 53), _ELSEWHERE(7)),
        (without_positions(60), ""),
        (without_positions(61), "61 rows and no x, y, z, its sweep has 60 points"),
        *(
            (with_several_values(name), f"field {name} has more than one value a point")
            for name in ("x", "flow_x", "valid")
        ),
    ],
)
def test_truth_that_does_not_fit_its_sweep_is_reported_and_not_used(message, text):
    truth, damage = matched(message)
    assert (truth is None) == bool(text)
    assert text in damage


def transforms(stamp_ns, *names):
    """A tf2_msgs/TFMessage: the pose of the drive as each of (frame, child frame)."""
    sec, nanosec = divmod(stamp_ns, 10**9)
    stamp = ros.builtin_interfaces__msg__Time(sec=sec, nanosec=nanosec)
    pose = small.pose((stamp_ns - small.stamp(0)) // (small.stamp(1) - small.stamp(0)))
    place = ros.geometry_msgs__msg__Vector3(*pose[:3, 3])
    turn = ros.geometry_msgs__msg__Quaternion(*pose_quaternion(pose))
    return ros.tf2_msgs__msg__TFMessage(
        [
            ros.geometry_msgs__msg__TransformStamped(
                header=ros.std_msgs__msg__Header(stamp=stamp, frame_id=parent),
                child_frame_id=child,
                transform=ros.geometry_msgs__msg__Transform(translation=place, rotation=turn),
            )
            for parent, child in names
        ]
    )


def test_poses_of_transforms_are_those_in_the_fixed_frame(tmp_path):
    others = [("base_link", "wheel"), ("map", "odom")]
    messages = [
        transforms(small.stamp(0), *others, ("/odom", "base_link"), ("odom", "payload")),
        transforms(small.stamp(1), *others),
        transforms(small.stamp(2), ("odom", "payload"), ("odom", "base_link")),
    ]
    with BagWriter(tmp_path / "drive") as writer:
        for index, message in enumerate(messages):
            raw = jazzy().serialize_cdr(message, TF_TYPE)
            writer.write_raw("/tf", TF_TYPE, small.stamp(index), raw)
            encoded = encode_columns(dict(zip("xyz", small.xyz(0).T, strict=True)), 1, 60)
            writer.write_cloud("/points", encoded, small.stamp(index), "lidar", is_dense=True)
    with BagReader(tmp_path / "drive") as reader:
        assert used_topics(reader.path, reader.topics, odometry="/tf").odometry == "/tf"
        poses = list(recorded_poses(reader, "/tf", "odom", Findings()))
    assert [(pose.stamp_ns, pose.frame_id) for pose in poses] == [
        (small.stamp(0), "base_link"),
        (small.stamp(2), "base_link"),
    ]
    np.testing.assert_allclose(poses[1].world_from_frame, small.pose(2), atol=1e-12)


def test_damage_of_odometry_says_which_message(tmp_path):
    findings, kind = Findings(), "nav_msgs/msg/Odometry"
    with BagWriter(tmp_path / "good") as writer:
        writer.write_odometry("/odometry", small.pose(1), small.stamp(1), "odom", "lidar")
    with BagReader(tmp_path / "good") as reader:
        ((_, good),) = reader.raw_messages("/odometry")
    x = struct.pack("<d", small.pose(1)[0, 3])
    assert x in good
    bad = good.replace(x, struct.pack("<d", np.nan))
    with BagWriter(tmp_path / "drive") as writer:
        for index, raw in enumerate((good, bad, good, bad)):
            writer.write_raw("/odometry", kind, small.stamp(index), raw)
    with BagReader(tmp_path / "drive") as reader:
        found = list(recorded_poses(reader, "/odometry", "odom", findings))
    assert [item is None for item in found] == [False, True, False, True]
    positions = [damage.position for damage in findings.damages]
    assert positions == ["message 1 on '/odometry'", "message 3 on '/odometry'"]


@pytest.mark.parametrize(
    ("order", "given"),
    [
        ([0, 2, 1, 3, 7, 4, 5, 6, 8, 9], list(range(10))),
        ([4, 3, 2, 1, 0, 5], list(range(6))),
        # Later than the window, and a recording that begins anew.
        ([0, 2, 3, 4, 5, 6, 7, 1, 8], [0, 2, 3, 4, 5, 6, 7, 1, 8]),
        ([10, 11, 12, 13, 14, 15, 3, 4, 6, 5], [10, 11, 12, 13, 14, 15, 3, 4, 5, 6]),
        ([0, 900, 2, 1, 3, 4, 5], [0, 1, 2, 3, 4, 5, 900]),
    ],
)
def test_messages_are_given_in_the_order_of_their_stamps(tmp_path, order, given):
    with BagWriter(tmp_path / "drive") as writer:
        for received, index in enumerate(order):
            encoded = encode_columns(dict(zip("xyz", small.xyz(0).T, strict=True)), 1, 60)
            raw = cloud_cdr(encoded, small.stamp(index))
            writer.write_raw("/points", CLOUD_TYPE, small.stamp(received), raw)
    with BagReader(tmp_path / "drive") as reader:
        sweeps = recorded_sweeps(reader, "/points", "drive", Settings(), Findings())
        assert [sweep.stamp_ns for sweep in sweeps] == [small.stamp(index) for index in given]


def test_sweeps_have_the_times_of_their_points(tmp_path):
    """Read by the same code as in the node; those that cannot be are told."""
    rows = np.arange(60)
    times = {
        "good": rows * 1_000_000,
        "bad": np.zeros(60),
        "one lost": np.where(rows == 7, 4e9, rows * 1e6),
    }
    findings = Findings()
    with BagWriter(tmp_path / "drive") as writer:
        for index, values in enumerate(times.values()):
            columns = dict(zip("xyz", small.xyz(index).T, strict=True))
            encoded = encode_columns({**columns, "t": values.astype(np.uint32)}, 1, 60)
            writer.write_cloud("/points", encoded, small.stamp(index), "lidar", is_dense=True)
    with BagReader(tmp_path / "drive") as reader:
        good, bad, lost = recorded_sweeps(reader, "/points", "drive", Settings(), findings)
    np.testing.assert_allclose(good.times_s, rows * 1e-3, atol=1e-7)
    assert bad.times_s is None
    kept = np.delete(rows, 7)
    np.testing.assert_array_equal(lost.source.rows, kept)
    np.testing.assert_array_equal(lost.xyz, small.xyz(2)[kept])
    np.testing.assert_allclose(lost.times_s, kept * 1e-3, atol=1e-7)
    assert findings.counts == {Event.SWEEPS_TIMES_UNUSED: 1, Event.POINTS_UNTIMED: 1}


def sector(number):
    """Points (400, 3) of a lidar that turns by 90 degrees with each cloud, and their truth."""
    random = np.random.default_rng(number)
    azimuths = np.radians(random.uniform(90 * number, 90 * number + 90, 400))
    xyz = np.stack([9 * np.cos(azimuths), 9 * np.sin(azimuths), random.uniform(-1, 1, 400)], axis=1)
    flow = np.full((400, 3), 0.1 * number, np.float32)
    flags = [np.full(400, value) for value in (True, False, False)]
    stamp_ns = small.FIRST_NS + number * small.STEP_NS // 4
    truth = FlowTruth(stamp_ns, flow, *flags, np.zeros(400, np.uint8), np.zeros(400, np.uint32))
    return xyz.astype(np.float32), truth


def test_sectors_are_revolutions_with_the_truth_of_their_parts(tmp_path):
    with BagWriter(tmp_path / "drive") as writer:
        for number in range(14):
            xyz, truth = sector(number)
            columns = dict(zip("xyz", xyz.T, strict=True))
            columns["t"] = np.linspace(0, 24e6, 400).astype(np.uint32)
            head = truth.stamp_ns, "lidar"
            writer.write_cloud("/points", encode_columns(columns, 1, 400), *head, is_dense=True)
            writer.write_cloud("/truth/flow", truth.encode(xyz), *head, is_dense=False)
    findings = Findings()
    with BagReader(tmp_path / "drive") as reader:
        first, gap, *sweeps = recorded_sweeps(reader, "/points", "drive", Settings(), findings)
        track = TruthTrack(truth_clouds(reader, "/truth/flow", findings), findings, "drive")
        truths = [track.take(sweep)[0] for sweep in (first, *sweeps)]
    assert (len(first), gap) == (400, None)
    assert [len(sweep) for sweep in sweeps] == [1600, 1600, 1600, 400]
    assert findings.counts == {Event.PARTS: 12}
    for start, sweep, truth in zip((1, 5, 9), sweeps, truths[1:], strict=False):
        parts = [sector(number) for number in range(start, start + 4)]
        np.testing.assert_array_equal(sweep.xyz, np.concatenate([xyz for xyz, _ in parts]))
        np.testing.assert_array_equal(sweep.source.rows, np.arange(1600))
        assert sweep.stamp_ns == parts[0][1].stamp_ns
        seconds = np.concatenate(
            [number * 0.025 + np.linspace(0, 0.024, 400) for number in range(4)]
        )
        np.testing.assert_allclose(sweep.times_s, seconds, atol=1e-6)
        expected = np.concatenate([truth.flow for _, truth in parts])
        np.testing.assert_array_equal(truth.flow, expected)


def write_static(writer, parent, child, turn=(0.0, 0.0, 0.0, 1.0)):
    """A transform on /tf_static, without a shift."""
    header = ros.std_msgs__msg__Header(ros.builtin_interfaces__msg__Time(0, 0), parent)
    place = ros.geometry_msgs__msg__Vector3(0.0, 0.0, 0.0)
    pose = ros.geometry_msgs__msg__Transform(place, ros.geometry_msgs__msg__Quaternion(*turn))
    one = ros.geometry_msgs__msg__TransformStamped(header, child, pose)
    raw = jazzy().serialize_cdr(ros.tf2_msgs__msg__TFMessage([one]), TF_TYPE)
    writer.write_raw("/tf_static", TF_TYPE, small.stamp(0), raw)


def imu_recording(path, *transforms):
    """Three sweeps, an IMU of 100 Hz in the frame `imu`, and static transforms."""
    with BagWriter(path) as writer:
        for index in range(3):
            points = encode_columns(dict(zip("xyz", small.xyz(index).T, strict=True)), 1, 60)
            writer.write_cloud("/points", points, small.stamp(index), "lidar")
        for number in range(-3, 40):
            stamp_ns = small.stamp(0) + number * 10_000_000
            writer.write_turn_rate("/imu/data", (0.1, 0.2, 0.3), stamp_ns, "imu")
        for transform in transforms:
            write_static(writer, *transform)
    return path


HALF_TURN = (1.0, 0.0, 0.0, 0.0)


@pytest.mark.parametrize(
    ("transforms", "expected"),
    [
        ([("base", "lidar"), ("base", "plate"), ("plate", "/imu", HALF_TURN)], [0.1, -0.2, -0.3]),
        ([("imu", "lidar", HALF_TURN)], [0.1, -0.2, -0.3]),
        ([("base", "lidar"), ("other", "imu")], None),
        ([("base", "lidar"), ("base", "imu", (0.0, 0.0, 0.0, np.nan))], None),
        ([("lidar", "base"), ("base", "lidar"), ("plate", "imu"), ("imu", "plate")], None),
        ([], None),
    ],
)
def test_turn_rates_are_turned_by_static_transforms(tmp_path, transforms, expected):
    path = imu_recording(tmp_path / "drive", *transforms)
    findings, off = Findings(), Settings().changed({"ego_motion.imu": False})
    with BagReader(path) as reader:
        sweeps = list(recorded_sweeps(reader, "/points", "drive", Settings(), findings))
        without = list(recorded_sweeps(reader, "/points", "drive", off, Findings()))
    assert all(sweep.turn_rates is None for sweep in without)
    if expected is None:
        assert all(sweep.turn_rates is None for sweep in sweeps)
        assert findings.counts == {Event.IMU_UNPLACED: 3}
        return
    assert findings.counts == {}
    for number, sweep in enumerate(sweeps):
        np.testing.assert_allclose(sweep.turn_rates[:, 1:], (4 + 10 * number) * [expected])
        np.testing.assert_allclose(sweep.turn_rates[-1, 0], 0.0, atol=1e-9)


def test_sweeps_after_the_end_of_an_imu_are_counted(tmp_path):
    with BagWriter(tmp_path / "drive") as writer:
        for index in range(3):
            points = encode_columns(dict(zip("xyz", small.xyz(index).T, strict=True)), 1, 60)
            writer.write_cloud("/points", points, small.stamp(index), "lidar")
        writer.write_turn_rate("/imu", (0.0, 0.0, 0.0), small.stamp(0), "lidar")
    findings = Findings()
    with BagReader(tmp_path / "drive") as reader:
        list(recorded_sweeps(reader, "/points", "drive", Settings(), findings))
    assert findings.counts == {Event.SWEEPS_WITHOUT_RATES: 2}
