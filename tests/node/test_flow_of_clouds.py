# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow cloud: fields, points and values of its input cloud, and the flow of each point."""

from __future__ import annotations

import numpy as np
from moving_boxes import MOTION, surfaces
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from synthetic_clouds import (
    ADDED_FIELDS,
    cloud_message,
    column,
    flow_columns,
    velocity_columns,
    xyz_columns,
    xyz_message,
)

from msg_utils.point_cloud2 import decode_points


def assert_shows_the_motion(flow):
    """The boxes' known motion, but for a few points at edges."""
    errors_m = np.linalg.norm(flow - MOTION, axis=1)
    assert np.median(errors_m) < 0.05
    assert np.quantile(errors_m, 0.95) < 0.15


def test_a_flow_has_the_header_the_shape_and_all_fields_of_its_cloud(peer, drive):
    stamps_ns = [drive.stamp_ns(index) + 123_456_789 + index for index in range(3)]
    sweeps = [drive.sweep(index, stamp_ns=stamp_ns) for index, stamp_ns in enumerate(stamps_ns)]
    sent, received = sweeps[1], peer.flow_amid(sweeps)
    assert received.header == sent.header
    assert (received.height, received.width) == (sent.height, sent.width)
    assert list(received.fields[: len(sent.fields)]) == list(sent.fields)
    added = [(item.name, item.datatype, item.count) for item in received.fields[len(sent.fields) :]]
    assert added == [(name, datatype, 1) for name, datatype in ADDED_FIELDS.items()]
    assert received.is_dense is True
    assert received.is_bigendian is False
    (info,) = peer.node.get_publishers_info_by_topic(peer.flow_topic)
    assert info.qos_profile.reliability == ReliabilityPolicy.RELIABLE
    assert info.qos_profile.durability == DurabilityPolicy.VOLATILE
    points, expected = decode_points(received), decode_points(sent)
    for name in ("x", "y", "z", "intensity"):
        np.testing.assert_array_equal(points[name], expected[name])


def test_points_that_are_not_finite_keep_their_place_and_have_no_flow(peer, drive):
    bad = {3: np.nan, 500: np.inf, 501: -np.inf, 1199: np.nan}
    messages = []
    for index in range(3):
        xyz = surfaces(index)
        for row, value in bad.items():
            xyz[row, row % 3] = value
        messages.append(xyz_message(xyz, stamp_ns=drive.stamp_ns(index)))
    received = peer.flow_amid(messages)
    assert received.is_dense is False
    flow = flow_columns(received)
    rows_without = np.flatnonzero(~np.isfinite(flow).all(axis=1))
    assert rows_without.tolist() == sorted(bad)
    assert np.isnan(flow[rows_without]).all()
    assert np.isnan(velocity_columns(received)[rows_without]).all()
    assert np.isnan(column(received, "confidence")[rows_without]).all()
    assert not column(received, "dynamic")[rows_without].any()
    np.testing.assert_array_equal(xyz_columns(received), xyz_columns(messages[1]))
    assert_shows_the_motion(np.delete(flow, rows_without, axis=0))


def test_fields_of_the_sensor_with_the_names_of_the_flow_are_kept_under_others(peer, drive):
    messages = []
    for index in range(3):
        columns = dict(zip("xyz", surfaces(index, 6000).T.copy(), strict=True))
        columns |= {name: np.full(6000, 99.0, np.float32) for name in ADDED_FIELDS}
        messages.append(cloud_message(columns, stamp_ns=drive.stamp_ns(index)))
    received = peer.flow_amid(messages)
    names = [item.name for item in received.fields]
    assert names == ["x", "y", "z", *(f"sensor_{name}" for name in ADDED_FIELDS), *ADDED_FIELDS]
    for name in ADDED_FIELDS:
        assert (column(received, f"sensor_{name}") == 99.0).all()
    # The line may reach the log after the flow has reached us.
    peer.spin_until(lambda: "vx as sensor_vx" in peer.process.log, "a line in the log")
    assert_shows_the_motion(flow_columns(received))
    # The world moves past the sensor: over ground nothing does.
    assert not column(received, "dynamic").any()
    assert not velocity_columns(received).any()
    assert (column(received, "confidence") <= 1).all()
