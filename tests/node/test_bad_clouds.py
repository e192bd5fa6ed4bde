# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Invalid, empty and damaged clouds are counted and skipped; the stream goes on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from synthetic_clouds import MOTION, cloud_message, flow_columns, surfaces, xyz_message

# Makes a cloud one that cannot be decoded.
SPOILERS = {
    "no z": lambda cloud: setattr(cloud, "fields", [f for f in cloud.fields if f.name != "z"]),
    "short data": lambda cloud: setattr(cloud, "data", cloud.data[:-1]),
    "point step 0": lambda cloud: setattr(cloud, "point_step", 0),
    "absurd width": lambda cloud: setattr(cloud, "width", 2**32 - 1),
    "absurd step": lambda cloud: setattr(cloud, "point_step", 2**32 - 1),
    "short rows": lambda cloud: setattr(cloud, "row_step", 1),
    "field outside": lambda cloud: setattr(cloud.fields[2], "offset", cloud.point_step),
    "absurd count": lambda cloud: setattr(cloud.fields[0], "count", 2**32 - 1),
    "unknown datatype": lambda cloud: setattr(cloud.fields[0], "datatype", 200),
    "whole numbers": lambda cloud: setattr(cloud.fields[0], "datatype", PointField.INT32),
    "negative time": lambda cloud: setattr(cloud.header.stamp, "sec", -1),
}


def spoiled(cloud, name="no z"):
    SPOILERS[name](cloud)
    return cloud


def test_an_undecodable_cloud_is_counted_and_skipped(peer, drive):
    before = peer.count("clouds_undecodable")
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps[:2])
    for number, name in enumerate(SPOILERS, start=1):
        peer.send(spoiled(drive.sweep(1.5), name))
        assert peer.count("clouds_undecodable") == before + number, name
    peer.send(sweeps[2])
    peer.flow_of(sweeps[1])
    assert peer.process.log.count("a cloud cannot be decoded") == 1
    # The diagnostics after one of them warn; not each of them is received.
    peer.send_until(
        itertools.repeat(spoiled(drive.sweep(3))),
        lambda: peer.status("input").level == b"\x01",
        "a warning",
    )
    assert peer.status("input").message == "clouds that cannot be decoded"


def test_a_cloud_without_a_finite_point_is_counted_and_skipped(peer, drive):
    before = peer.count("clouds_empty")
    sweeps, stamp_ns = drive.sweeps(0, 1, 2), drive.stamp_ns(1.5)
    empty = [
        xyz_message(np.zeros((0, 3), np.float32), stamp_ns=stamp_ns),
        xyz_message(np.full((1000, 3), np.nan, np.float32), stamp_ns=stamp_ns),
        xyz_message(np.full((20, 3), np.inf, np.float32), stamp_ns=stamp_ns),
        PointCloud2(),
    ]
    peer.send(*sweeps[:2], *empty, sweeps[2])
    peer.flow_of(sweeps[1])
    assert peer.count("clouds_empty") == before + len(empty)


@pytest.mark.parametrize(
    "xyz",
    [np.ones((1, 3), np.float32), np.full((50, 3), 1e7, np.float32)],
    ids=["one point", "all far away"],
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


@pytest.mark.parametrize("value", [np.nan, 1e7, -3e38, 1e300])
def test_stray_values_among_good_points_do_no_harm(peer, drive, value):
    messages = []
    for index in range(3):
        xyz = surfaces(index).astype(np.float64)
        xyz[::100, index % 3] = value
        columns = dict(zip("xyz", xyz.T.copy(), strict=True))
        messages.append(cloud_message(columns, stamp_ns=drive.stamp_ns(index)))
    peer.send(*messages)
    flow = flow_columns(peer.flow_of(messages[1]))
    # Beyond single precision a coordinate counts as infinite.
    is_finite = abs(value) < 1e39
    assert np.isfinite(flow).all(axis=1).sum() == (1200 if is_finite else 1188)
    good = np.delete(flow, slice(None, None, 100), axis=0)
    assert np.median(np.linalg.norm(good - MOTION, axis=1)) < 0.1


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


def test_random_damage_does_not_end_the_node(peer, drive):
    random = np.random.default_rng(0)
    whole = serialize_message(drive.sweep(0, num_points=60))
    peer.send(whole.replace(b"lidar\x00", b"\xff\xfe\xc3\x28\xc3\x00"))
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
    peer.wait_until_settled()
    assert peer.num_open_triplets == 0
