# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A new field of the output cloud is one row in the table of columns."""

from __future__ import annotations

import numpy as np
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2
from synthetic_clouds import column, surfaces, xyz_message

from mnsf_ros.core import flow_columns
from mnsf_ros.core.flow_columns import FLOW_COLUMNS, FlowColumn
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.node.flow_outputs import FlowOutputs
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import sweep_from_message


def test_a_row_of_the_table_is_a_field_of_the_published_cloud(monkeypatch):
    length = FlowColumn(
        "flow_length",
        np.float32,
        np.nan,
        "m",
        "length of the flow",
        lambda estimate, _interval_s: np.linalg.norm(estimate.flow, axis=1),
    )
    monkeypatch.setattr(flow_columns, "FLOW_COLUMNS", (*FLOW_COLUMNS, length))
    messages = [xyz_message(surfaces(index), stamp_ns=10**9 + index * 10**8) for index in range(3)]
    sweeps = [sweep_from_message(message, Settings().time, 0) for message in messages]
    flow = np.full(sweeps[1].xyz.shape, 2.0, np.float32)
    published = []
    context = Context()
    rclpy.init(context=context)
    try:
        node = Node("columns", context=context)
        outputs = FlowOutputs(node, "odom")
        monkeypatch.setattr(outputs._flow, "publish", published.append)
        monkeypatch.setattr(outputs._flow, "get_subscription_count", lambda: 1)
        estimate = FlowEstimate(flow, np.ones(len(flow), bool))
        outputs.publish(SweepTriplet(*sweeps), estimate)
        node.destroy_node()
    finally:
        context.try_shutdown()
    message = deserialize_message(published[0], PointCloud2)
    assert [field.name for field in message.fields[-2:]] == ["rgb", "flow_length"]
    np.testing.assert_allclose(column(message, "flow_length"), np.sqrt(12), rtol=1e-6)
