# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The output topics: parts of the flow, layouts, objects; each is built for subscribers only."""

from __future__ import annotations

import time
from dataclasses import replace

import numpy as np
import pytest
import rclpy
from rclpy.executors import SingleThreadedExecutor
from scene_flow_process import PATIENCE_S
from sensor_msgs.msg import PointCloud2, PointField
from synthetic_clouds import column, surfaces, xyz_columns, xyz_message
from tracked_objects import tracked
from visualization_msgs.msg import Marker, MarkerArray

from mnsf_ros.core import flow_columns
from mnsf_ros.core.flow_columns import FLOW_COLUMNS, FlowColumn
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.node import flow_outputs
from mnsf_ros.node.flow_outputs import FlowOutputs
from mnsf_ros.settings import OutputSettings, Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import renamed_fields, sweep_from_message
from msg_utils.point_cloud2 import decode_points

NUM_POINTS = 600
NUM_DYNAMIC = 60
FULL, MOVING, STANDING = "/clouds/flow", "/clouds/flow/moving", "/clouds/flow/standing"
OBJECTS, MARKERS = "/clouds/objects", "/clouds/objects/markers"
FULL_LAYOUT, COMPACT, COLORLESS = (
    OutputSettings(),
    OutputSettings("compact"),
    OutputSettings(rgb=False),
)
COMPACT_NAMES = ["x", "y", "z", "flow_x", "flow_y", "flow_z", "dynamic"]


class Outputs:
    """The outputs under test, and subscriptions of the same node."""

    def __init__(self, node):
        self._node = node
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(node)
        self._subscriptions = {}
        self.outputs = FlowOutputs(node, "odom")
        self.heard = {}

    def close(self):
        self._executor.shutdown()

    def hear(self, *topics):
        for topic in topics:
            self.heard[topic] = []
            kind = MarkerArray if topic == MARKERS else PointCloud2
            self._subscriptions[topic] = self._node.create_subscription(
                kind, topic, self.heard[topic].append, 10
            )
            self._spin_until(lambda topic=topic: self._node.count_subscribers(topic) == 1)
        self._spin_until(lambda: self.outputs.are_watched)

    def leave(self, topic):
        self._node.destroy_subscription(self._subscriptions.pop(topic))
        self._spin_until(lambda: self._node.count_subscribers(topic) == 0)

    def publish(self, *topics, estimate=None, **how):
        """Publishes an estimate; the messages that came on these topics."""
        before = {topic: len(self.heard[topic]) for topic in topics}
        self.outputs.publish(triplet(), estimate or made_estimate(), **how)
        self._spin_until(lambda: all(len(self.heard[key]) > before[key] for key in topics))
        return [self.heard[topic][-1] for topic in topics]

    def _spin_until(self, condition):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up
            self._executor.spin_once(timeout_sec=0.02)


@pytest.fixture
def clouds(ros):
    node = rclpy.create_node("clouds")
    clouds = Outputs(node)
    yield clouds
    clouds.close()
    node.destroy_node()


@pytest.fixture
def built(monkeypatch):
    """Number of points of each cloud that was built."""
    numbers, build = [], flow_outputs.flow_cloud

    def counting(sweep, *arguments, **how):
        numbers.append(len(sweep))
        return build(sweep, *arguments, **how)

    monkeypatch.setattr(flow_outputs, "flow_cloud", counting)
    return numbers


def triplet():
    """Three sweeps; the fifth point of their clouds is not finite."""
    messages = []
    for index in range(3):
        xyz = surfaces(index, NUM_POINTS)
        xyz[4] = np.nan
        messages.append(xyz_message(xyz, stamp_ns=10**9 + index * 10**8))
    return SweepTriplet(*(sweep_from_message(message, Settings().time, 0) for message in messages))


def made_estimate(*objects, has_tracks=False):
    number = NUM_POINTS - 1
    over_ground = OverGround(
        motion=np.arange(3 * number, dtype=np.float32).reshape(-1, 3),
        dynamic=np.arange(number) % 10 == 0,
        confidence=np.linspace(0, 1, number, dtype=np.float32),
        world_from_sensor=np.eye(4),
        next_from_current=np.eye(4),
        source="registration",
        objects=objects,
        track_ids=np.zeros(number, np.int32) if has_tracks else None,
    )
    flow = np.arange(3 * number, dtype=np.float32).reshape(-1, 3) / 7
    return FlowEstimate(flow, np.ones(number, bool), over_ground=over_ground)


def assert_is_part(part, whole, is_dynamic):
    """Every byte of the points of a part is that of the same points in the whole cloud."""
    points, finite = decode_points(whole).ravel(), np.arange(NUM_POINTS) != 4
    wanted = points[finite & (points["dynamic"] == is_dynamic)]
    assert (part.height, part.width, part.is_dense) == (1, len(wanted), True)
    assert part.fields == whole.fields
    assert part.header == whole.header
    for name in points.dtype.names:
        np.testing.assert_array_equal(decode_points(part).ravel()[name], wanted[name])


@pytest.mark.parametrize("layout", [FULL_LAYOUT, COMPACT, COLORLESS], ids=str)
def test_parts_have_the_points_of_the_whole_cloud(clouds, layout):
    clouds.hear(FULL, MOVING, STANDING)
    full, moving, standing = clouds.publish(FULL, MOVING, STANDING, layout=layout)
    assert not full.is_dense
    assert_is_part(moving, full, 1)
    assert_is_part(standing, full, 0)


def test_only_clouds_with_subscribers_are_built(clouds, built):
    assert not clouds.outputs.are_watched
    clouds.publish()
    assert built == []
    clouds.hear(FULL)
    clouds.publish(FULL)
    clouds.hear(MOVING)
    clouds.publish(FULL, MOVING)
    clouds.leave(FULL)
    clouds.publish(MOVING)
    clouds.leave(MOVING)
    clouds.publish()
    whole = NUM_POINTS - 1
    assert built == [whole, whole, NUM_DYNAMIC, NUM_DYNAMIC]


def test_layouts(clouds):
    clouds.hear(FULL)
    (compact,) = clouds.publish(FULL, layout=COMPACT)
    (colorless,) = clouds.publish(FULL, layout=COLORLESS)
    (full,) = clouds.publish(FULL)
    assert [field.name for field in compact.fields] == COMPACT_NAMES
    assert compact.point_step == 25
    assert (compact.height, compact.width) == (full.height, full.width)
    assert compact.header == full.header
    for name in COMPACT_NAMES:
        np.testing.assert_array_equal(column(compact, name), column(full, name))
    assert np.isnan(xyz_columns(compact)[4]).all()
    assert [field.name for field in full.fields][:-1] == [f.name for f in colorless.fields]
    assert (full.fields[-1].name, full.fields[-1].datatype) == ("rgb", PointField.FLOAT32)


def test_flow_of_a_method_without_ego_motion(clouds):
    clouds.hear(FULL)
    estimate = replace(made_estimate(), over_ground=None)
    (cloud,) = clouds.publish(FULL, estimate=estimate, layout=COMPACT)
    assert not column(cloud, "dynamic").any()
    assert np.isfinite(column(cloud, "flow_x")).sum() == NUM_POINTS - 1


def test_a_field_of_the_sensor_is_renamed_only_for_a_column_of_the_layout():
    cloud = triplet().current.source.message
    cloud.fields[-1].name = "rgb"
    assert renamed_fields(cloud, FULL_LAYOUT) == {"rgb": "sensor_rgb"}
    assert renamed_fields(cloud, COLORLESS) == renamed_fields(cloud, COMPACT) == {}


def test_a_row_of_the_table_of_columns_is_a_field_of_the_cloud(clouds, monkeypatch):
    length = FlowColumn(
        "flow_length",
        np.float32,
        np.nan,
        "m",
        "length of the flow",
        lambda estimate, _interval_s: np.linalg.norm(estimate.flow, axis=1),
    )
    monkeypatch.setattr(flow_columns, "FLOW_COLUMNS", (*FLOW_COLUMNS, length))
    clouds.hear(FULL)
    (cloud,) = clouds.publish(FULL)
    assert [field.name for field in cloud.fields[-2:]] == ["rgb", "flow_length"]
    expected = np.linalg.norm(made_estimate().flow, axis=1)
    np.testing.assert_allclose(np.delete(column(cloud, "flow_length"), 4), expected, rtol=1e-6)


def test_objects_have_the_header_of_their_sweep_until_they_are_gone(clouds):
    clouds.hear(OBJECTS, MARKERS)
    cloud, markers = clouds.publish(
        OBJECTS, MARKERS, estimate=made_estimate(tracked(5), has_tracks=True)
    )
    header = triplet().current.source.message.header
    assert cloud.header == header
    assert column(cloud, "id").tolist() == [5]
    assert all(marker.header == header for marker in markers.markers)
    cloud, markers = clouds.publish(OBJECTS, MARKERS, estimate=made_estimate(has_tracks=True))
    assert cloud.width == 0
    assert {(marker.id, marker.action) for marker in markers.markers} == {(5, Marker.DELETE)}


def test_a_method_without_tracks_publishes_no_objects(clouds):
    clouds.hear(OBJECTS)
    clouds.publish()
    clouds.publish(OBJECTS, estimate=made_estimate(tracked(6), has_tracks=True))
    (cloud,) = clouds.heard[OBJECTS]
    assert column(cloud, "id").tolist() == [6]
