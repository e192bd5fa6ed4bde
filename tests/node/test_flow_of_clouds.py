# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow cloud: fields, points and values of its input cloud, and the flow of each point."""

import numpy as np
from moving_boxes import MOTION
from rclpy.qos import DurabilityPolicy, ReliabilityPolicy
from synthetic_clouds import (
    ADDED_FIELDS,
    column,
    flow_columns,
    velocity_columns,
)

from msg_utils.point_cloud2 import decode_points


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
    errors_m = np.linalg.norm(flow_columns(received) - MOTION, axis=1)
    assert np.median(errors_m) < 0.05
    assert np.quantile(errors_m, 0.95) < 0.15
    # The world moves past the sensor: over ground nothing does.
    assert not column(received, "dynamic").any()
    assert not velocity_columns(received).any()
