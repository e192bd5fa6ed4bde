# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Bad clouds, stamps and times are counted and said once; the flow goes on."""

import itertools

import numpy as np
import pytest
import rclpy
from moving_boxes import surfaces
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from synthetic_clouds import cloud_message, xyz_message

# Makes a cloud one that cannot be decoded; of each kind of check one.
SPOILERS = {
    "no z": lambda cloud: setattr(cloud, "fields", [f for f in cloud.fields if f.name != "z"]),
    "short data": lambda cloud: setattr(cloud, "data", cloud.data[:-1]),
    "absurd width": lambda cloud: setattr(cloud, "width", 2**32 - 1),
    "negative time": lambda cloud: setattr(cloud.header.stamp, "sec", -1),
}


def spoiled(cloud, name="no z"):
    SPOILERS[name](cloud)
    return cloud


def test_an_undecodable_cloud_is_counted_and_skipped(peer, drive):
    before = peer.count("clouds_undecodable")
    sweeps = drive.sweeps(0, 1, 2)
    bad = [spoiled(drive.sweep(1.5), name) for name in SPOILERS]
    peer.send(*sweeps[:2], *bad, sweeps[2])
    peer.flow_of(sweeps[1])
    assert peer.count("clouds_undecodable") == before + len(bad)
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
        xyz_message(np.full((1000, 3), np.nan, np.float32), stamp_ns=stamp_ns),
        PointCloud2(),
    ]
    peer.send(*sweeps[:2], *empty, sweeps[2])
    peer.flow_of(sweeps[1])
    assert peer.count("clouds_empty") == before + len(empty)


# Not 0: Fast DDS itself accepts nothing any more after an empty sample of a reliable publisher.
@pytest.mark.parametrize("size", [1, -100])
def test_bytes_that_are_no_message_do_no_harm(peer, drive, size):
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps[:2])
    peer.publish(serialize_message(sweeps[2])[:size])
    peer.send(sweeps[2])
    peer.flow_of(sweeps[1])


def test_an_odd_stamp_is_counted_and_said_once(peer, drive):
    peer.flow_amid(drive.sweeps(0, 1, 2))
    before = peer.count("sweeps_gap")
    peer.flow_amid(drive.sweeps(12, 13, 14))
    assert peer.count("sweeps_gap") == before + 1
    assert peer.process.log.count("sweeps are more than buffer.max_interval_s apart") == 1


@pytest.mark.parametrize(
    ("column", "num_invalid", "source"),
    [
        (
            {"t": np.linspace(0, 99e6, 1200).astype(np.uint32)},
            0,
            "field 't' (uint32, ns, relative to the stamp)",
        ),
        ({"timestamp": np.full(1200, 7.0)}, 3, "none"),
    ],
    ids=["usable", "invalid"],
)
def test_times_of_points_are_said_and_cost_no_flow(peer, drive, column, num_invalid, source):
    before = peer.count("clouds_without_usable_times")
    sweeps = [
        cloud_message(
            dict(zip("xyz", surfaces(index).astype(np.float32).T.copy(), strict=True)) | column,
            stamp_ns=drive.stamp_ns(index),
        )
        for index in range(3)
    ]
    peer.flow_amid(sweeps)
    assert peer.count("clouds_without_usable_times") == before + num_invalid
    assert peer.values("input")["time of each point"] == source


def test_a_second_node_of_its_name_is_told(peer):
    namespace, _, name = peer.flow_topic.removesuffix("/flow").rpartition("/")
    namesake = rclpy.create_node(name, namespace=namespace, start_parameter_services=False)
    peer.spin_until(lambda: f"2 nodes have the name {name}" in peer.process.log, "a warning")
    namesake.destroy_node()
