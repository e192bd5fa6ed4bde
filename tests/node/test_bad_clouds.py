# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import array
import itertools

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from synthetic_clouds import MOTION, cloud_message, flow_columns, surfaces, xyz_message


def without_z(message):
    message.fields = [item for item in message.fields if item.name != "z"]


def with_short_data(message):
    message.data = message.data[:-1]


def without_data(message):
    message.data = array.array("B")


def with_point_step_zero(message):
    message.point_step = 0


def with_absurd_size(message):
    message.width = message.height = 2**32 - 1


def with_absurd_steps(message):
    message.point_step = message.row_step = 2**32 - 1


def with_field_beyond_the_point(message):
    message.fields[2].offset = message.point_step


def with_absurd_count(message):
    message.fields[0].count = 2**32 - 1


def with_unknown_datatype(message):
    message.fields[0].datatype = 200


def with_whole_numbers(message):
    message.fields[0].datatype = PointField.INT32


def with_too_short_rows(message):
    message.row_step = 1


def with_time_before_the_epoch(message):
    message.header.stamp.sec = -1


@pytest.mark.parametrize(
    "spoil",
    [
        without_z,
        with_short_data,
        without_data,
        with_point_step_zero,
        with_absurd_size,
        with_absurd_steps,
        with_field_beyond_the_point,
        with_absurd_count,
        with_unknown_datatype,
        with_whole_numbers,
        with_too_short_rows,
        with_time_before_the_epoch,
    ],
)
def test_a_cloud_that_cannot_be_decoded_is_counted_and_left_out(peer, drive, quick_node, spoil):
    before = peer.count("clouds_undecodable")
    bad = drive.sweep(0)
    spoil(bad)
    peer.send(bad)
    assert peer.count("clouds_undecodable") == before + 1
    assert quick_node.log.count("a cloud cannot be decoded") == 1


def test_a_cloud_that_cannot_be_decoded_does_not_interrupt_the_stream(peer, drive):
    sweeps, bad = drive.sweeps(0, 1, 2), drive.sweep(1.5)
    without_z(bad)
    peer.send(*sweeps[:2], bad, sweeps[2])
    peer.flow_of(sweeps[1])


def test_undecodable_clouds_are_a_warning(peer, drive):
    bad = drive.sweep(0)
    without_z(bad)
    # The diagnostics after one of them say so; not each of them is received.
    peer.send_until(
        itertools.repeat(bad), lambda: peer.status("input").level == b"\x01", "a warning"
    )
    assert peer.status("input").message == "clouds that cannot be decoded"


@pytest.mark.parametrize(
    "xyz",
    [
        np.zeros((0, 3), np.float32),
        np.full((1, 3), np.nan, np.float32),
        np.full((1000, 3), np.nan, np.float32),
        np.full((20, 3), np.inf, np.float32),
    ],
    ids=["no point", "one NaN", "all NaN", "all infinite"],
)
def test_a_cloud_without_a_finite_point_is_counted_and_left_out(peer, drive, xyz):
    before = peer.count("clouds_empty")
    sweeps = drive.sweeps(0, 1, 2)
    bad = xyz_message(xyz, stamp_ns=drive.stamp_ns(1.5))
    peer.send(*sweeps[:2], bad, sweeps[2])
    peer.flow_of(sweeps[1])
    assert peer.count("clouds_empty") == before + 1


def test_an_empty_message_is_counted_and_left_out(peer):
    before = peer.count("clouds_empty")
    peer.send(PointCloud2())
    assert peer.count("clouds_empty") == before + 1


@pytest.mark.parametrize(
    "xyz",
    [np.ones((1, 3), np.float32), np.full((50, 3), 1e7, np.float32), np.zeros((50, 3), np.float32)],
    ids=["one point", "all far away", "all at the sensor"],
)
def test_a_sweep_with_too_few_points_fails_three_triplets_and_the_next_is_fine(peer, drive, xyz):
    peer.wait_until_settled()
    before = peer.count("estimates_failed")
    messages = drive.sweeps(*range(8))
    messages[3] = xyz_message(xyz, stamp_ns=drive.stamp_ns(3))
    for message in messages:
        peer.send(message)
        peer.wait_until_settled()
    assert peer.count("estimates_failed") == before + 3
    assert f"of {len(xyz)} points are left" in peer.values("flow")["last failure"]
    assert peer.num_open_triplets == 0
    peer.flow_of(messages[6])
    assert peer.status("flow").message == "estimating"


@pytest.mark.parametrize("value", [np.nan, -np.inf, 1e7, -3e38])
def test_stray_values_among_good_points_do_no_harm(peer, drive, value):
    messages = []
    for index in range(3):
        xyz = surfaces(index)
        xyz[::100, index % 3] = value
        messages.append(xyz_message(xyz, stamp_ns=drive.stamp_ns(index)))
    peer.send(*messages)
    flow = flow_columns(peer.flow_of(messages[1]))
    assert np.isfinite(flow).all(axis=1).sum() == (1200 if np.isfinite(value) else 1188)
    good = np.delete(flow, slice(None, None, 100), axis=0)
    assert np.median(np.linalg.norm(good - MOTION, axis=1)) < 0.1


def test_coordinates_beyond_single_precision_count_as_infinite(peer, drive):
    messages = []
    for index in range(3):
        columns = dict(zip("xyz", surfaces(index).astype(np.float64).T.copy(), strict=True))
        columns["y"][7] = 1e300
        messages.append(cloud_message(columns, stamp_ns=drive.stamp_ns(index)))
    peer.send(*messages)
    flow = flow_columns(peer.flow_of(messages[1]))
    assert np.flatnonzero(~np.isfinite(flow).all(axis=1)).tolist() == [7]


def test_sweeps_without_any_motion_have_no_flow(peer, drive):
    messages = [xyz_message(surfaces(0), stamp_ns=drive.stamp_ns(index)) for index in range(3)]
    peer.send(*messages)
    flow = flow_columns(peer.flow_of(messages[1]))
    assert np.median(np.linalg.norm(flow, axis=1)) < 0.05


def test_all_points_at_one_place(peer, drive):
    messages = [
        xyz_message(np.full((50, 3), 2.0, np.float32), stamp_ns=drive.stamp_ns(index))
        for index in range(3)
    ]
    peer.send(*messages)
    assert np.isfinite(flow_columns(peer.flow_of(messages[1]))).all()


# Not 0: Fast DDS itself accepts nothing any more after an empty sample of a reliable publisher.
@pytest.mark.parametrize("size", [1, 60, -100])
def test_bytes_that_are_no_message_do_no_harm(peer, drive, size):
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps[:2])
    peer.publish(serialize_message(sweeps[2])[:size])
    peer.send(sweeps[2])
    peer.flow_of(sweeps[1])


def test_a_frame_id_that_is_no_text_does_no_harm(peer, drive, quick_node):
    sweep = serialize_message(drive.sweep(0))
    peer.send(sweep.replace(b"lidar\x00", b"\xff\xfe\xc3\x28\xc3\x00"))
    assert quick_node.is_running


def test_random_damage_does_not_end_the_node(peer, drive, quick_node):
    random = np.random.default_rng(0)
    whole = serialize_message(drive.sweep(0, num_points=60))
    for index in range(100):
        damaged = np.frombuffer(whole, np.uint8).copy()
        damaged[4:12] = np.frombuffer(
            np.array([drive.stamp_ns(index) // 10**9, index * 10**6], "<u4").tobytes(), np.uint8
        )
        # Behind the four bytes that say how the rest is encoded.
        places = random.integers(4, len(damaged), random.integers(1, 8))
        damaged[places] = random.integers(0, 256, len(places))
        peer.publish(damaged.tobytes())
        peer.spin_some()
    sweeps = drive.sweeps(100, 101, 102)
    peer.send(*sweeps)
    peer.flow_of(sweeps[1])
    assert quick_node.is_running
    peer.wait_until_settled()
    assert peer.num_open_triplets == 0
