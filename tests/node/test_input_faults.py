# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Bad clouds, stamps and times are counted and said once; the flow goes on."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from moving_boxes import MOTION, surfaces
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from synthetic_clouds import cloud_message, flow_columns, xyz_message

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


def sweeps_of_columns(drive, values=None, **columns):
    """Three sweeps of the boxes with further columns; `values` changes the positions (N, 3)."""
    messages = []
    for index in range(3):
        xyz = surfaces(index).astype(np.float64 if values else np.float32)
        if values:
            values(xyz, index)
        axes = dict(zip("xyz", xyz.T.copy(), strict=True))
        messages.append(cloud_message(axes | columns, stamp_ns=drive.stamp_ns(index)))
    return messages


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


@pytest.mark.parametrize("value", [np.nan, -3e38, 1e300])
def test_stray_values_among_good_points_do_no_harm(peer, drive, value):
    def spoil(xyz, index):
        xyz[::100, index] = value

    flow = flow_columns(peer.flow_amid(sweeps_of_columns(drive, spoil)))
    # Beyond single precision a coordinate counts as infinite.
    is_finite = abs(value) < 1e39
    assert np.isfinite(flow).all(axis=1).sum() == (1200 if is_finite else 1188)
    good = np.delete(flow, slice(None, None, 100), axis=0)
    assert np.median(np.linalg.norm(good - MOTION, axis=1)) < 0.1


# Not 0: Fast DDS itself accepts nothing any more after an empty sample of a reliable publisher.
@pytest.mark.parametrize("size", [1, -100])
def test_bytes_that_are_no_message_do_no_harm(peer, drive, size):
    sweeps = drive.sweeps(0, 1, 2)
    peer.send(*sweeps[:2])
    peer.publish(serialize_message(sweeps[2])[:size])
    peer.send(sweeps[2])
    peer.flow_of(sweeps[1])


class TestStamps:
    @pytest.fixture
    def under_way(self, peer, drive):
        """A drive of which three sweeps are through; the events it starts with do not count."""
        peer.flow_amid(drive.sweeps(0, 1, 2))
        return drive

    @pytest.mark.parametrize(
        ("event", "odd_index", "next_index"),
        [
            ("duplicate", 2, 3),
            ("out_of_order", 1.5, 3),
            ("gap", 12, 13),
            ("time_went_back", -20, -19),
        ],
    )
    def test_an_odd_one_is_counted_and_said_once(
        self, peer, under_way, event, odd_index, next_index
    ):
        before = peer.count(f"sweeps_{event}")
        peer.send(under_way.sweep(odd_index))
        assert peer.count(f"sweeps_{event}") == before + 1
        peer.flow_amid(under_way.sweeps(next_index, next_index + 1, next_index + 2))
        said = f"{event.replace('_', ' ')} (at most every 10 min, counted in /diagnostics)"
        assert peer.process.log.count(said) == 1

    def test_that_are_missing_are_the_time_of_arrival(self, peer, drive):
        before, sent = peer.count("clouds_without_stamp"), []
        peer.flows.clear()

        def sweeps():
            for index in itertools.count():
                sent.append(drive.sweep(index % 20, stamp_ns=0))
                yield sent[-1]

        # On a slow machine some arrive so far apart that there is a gap between them.
        peer.send_until(sweeps(), lambda: 0 in peer.flows, "the flow")
        assert peer.count("clouds_without_stamp") == before + len(sent) >= before + 3
        assert peer.process.log.count("no stamp") == 1
        peer.wait_until_settled()
        assert peer.num_open_triplets == 0


@pytest.mark.parametrize(
    ("column", "num_invalid", "source", "said"),
    [
        (
            {"t": np.linspace(0, 99e6, 1200).astype(np.uint32)},
            0,
            "field 't' (uint32, ns, relative to the stamp)",
            "time of each point: field 't' (uint32, ns, relative to the stamp)",
        ),
        ({"timestamp": np.full(1200, 7.0)}, 3, "none", "the times of points are not used"),
    ],
    ids=["usable", "invalid"],
)
def test_times_of_points_are_said_and_cost_no_flow(peer, drive, column, num_invalid, source, said):
    before = peer.count("clouds_without_usable_times")
    peer.flow_amid(sweeps_of_columns(drive, **column))
    assert peer.count("clouds_without_usable_times") == before + num_invalid
    assert peer.values("input")["time of each point"] == source
    assert peer.process.log.count(said) == 1
