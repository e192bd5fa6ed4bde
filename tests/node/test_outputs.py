# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The output topics: parts of the flow, layouts, objects; each is built for subscribers only."""

import numpy as np
import pytest
from moving_boxes import surfaces
from node_harness import Spinner
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2, PointField
from synthetic_clouds import (
    ADDED_FIELDS,
    cloud_message,
    column,
    over_ground,
    tracked,
)
from visualization_msgs.msg import Marker, MarkerArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.node import flow_outputs
from mnsf_ros.node.flow_outputs import FlowOutputs
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io import movers_at_stamp
from mnsf_ros.sweeps_io.flow_cloud import CloudReader, flow_cloud
from msg_utils.point_cloud2 import decode_points

NUM_POINTS = 600
NUM_DYNAMIC = 60
FULL, MOVING, STANDING = "/clouds/flow", "/clouds/flow/moving", "/clouds/flow/standing"
OBJECTS, MARKERS = "/clouds/objects", "/clouds/objects/markers"
PREDICTED, CLEARING = "/clouds/predicted", "/clouds/predicted/clearing"
FULL_LAYOUT, COMPACT, COLORLESS = (
    Settings().changed(changes)
    for changes in ({}, {"output.layout": "compact"}, {"output.rgb": False})
)
TIMES_NS = np.linspace(0, 10**8 - 1, NUM_POINTS).astype(np.uint32)
COMPACT_NAMES = ["x", "y", "z", "flow_x", "flow_y", "flow_z", "dynamic"]


class Outputs(Spinner):
    """The outputs under test, and subscriptions of the same node."""

    def __init__(self):
        super().__init__("clouds")
        self._subscriptions = {}
        self.outputs = FlowOutputs(self.node, "odom")
        self.heard = {}

    def hear(self, *topics):
        for topic in topics:
            self.heard[topic] = []
            kind = MarkerArray if topic == MARKERS else PointCloud2
            self._subscriptions[topic] = self.node.create_subscription(
                kind, topic, self.heard[topic].append, 10
            )
            self._wait_for_subscribers(topic, 1)
        self.spin_until(lambda: self.outputs.are_watched, "the outputs to be watched")

    def leave(self, topic):
        self.node.destroy_subscription(self._subscriptions.pop(topic))
        self._wait_for_subscribers(topic, 0)

    def publish(self, *topics, estimate=None, **how):
        """Publishes an estimate; the messages that came on these topics."""
        before = {topic: len(self.heard[topic]) for topic in topics}
        self.outputs.publish(triplet(), estimate or made_estimate(), **how)
        self.spin_until(
            lambda: all(len(self.heard[topic]) > before[topic] for topic in topics), "the messages"
        )
        return [self.heard[topic][-1] for topic in topics]

    def _wait_for_subscribers(self, topic, number):
        count = self.node.count_subscribers
        self.spin_until(lambda: count(topic) == number, f"{number} subscribers of {topic}")


@pytest.fixture
def clouds(ros):
    clouds = Outputs()
    yield clouds
    clouds.close()


@pytest.fixture
def built(monkeypatch):
    """Number of points of each cloud that was built."""
    numbers, build = [], flow_outputs.flow_cloud

    def counting(sweep, estimate, interval_s, layout, part=None, moved=None):
        numbers.append(len(sweep) if part is None else part.sum())
        return build(sweep, estimate, interval_s, layout, part, moved)

    for module in (flow_outputs, movers_at_stamp):
        monkeypatch.setattr(module, "flow_cloud", counting)
    return numbers


def triplet():
    """Three sweeps; the fifth point of their clouds is not finite."""
    messages = []
    for index in range(3):
        xyz = surfaces(index, NUM_POINTS)
        xyz[4] = np.nan
        columns = dict(zip("xyz", xyz.T, strict=True), t=TIMES_NS)
        messages.append(cloud_message(columns, stamp_ns=10**9 + index * 10**8))
    return SweepTriplet(*(CloudReader().sweep(message, Settings().time, 0) for message in messages))


def made_estimate(number=NUM_POINTS - 1, objects=(), *, has_tracks=False, lost=""):
    known = over_ground(
        motion=np.arange(3 * number, dtype=np.float32).reshape(-1, 3),
        dynamic=np.arange(number) % 10 == 0,
        confidence=np.linspace(0, 1, number, dtype=np.float32),
        objects=objects,
        track_ids=np.zeros(number, np.int32) if has_tracks else None,
        lost=lost,
    )
    flow = np.arange(3 * number, dtype=np.float32).reshape(-1, 3) / 7
    return FlowEstimate(flow, np.ones(number, bool), over_ground=known)


def assert_is_part(part, whole, is_dynamic):
    """Every byte of the points of a part is that of the same points in the whole cloud."""
    points, finite = decode_points(whole).ravel(), np.arange(NUM_POINTS) != 4
    wanted = points[finite & (points["dynamic"] == is_dynamic)]
    assert (part.height, part.width, part.is_dense) == (1, len(wanted), True)
    assert part.fields == whole.fields
    assert part.header == whole.header
    for name in points.dtype.names:
        np.testing.assert_array_equal(decode_points(part).ravel()[name], wanted[name])


@pytest.mark.parametrize("settings", [FULL_LAYOUT, COMPACT, COLORLESS], ids=lambda s: str(s.output))
def test_parts_have_the_points_of_the_whole_cloud(clouds, settings):
    clouds.hear(FULL, MOVING, STANDING)
    full, moving, standing = clouds.publish(FULL, MOVING, STANDING, settings=settings)
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
    (compact,) = clouds.publish(FULL, settings=COMPACT)
    (colorless,) = clouds.publish(FULL, settings=COLORLESS)
    (full,) = clouds.publish(FULL)
    assert [field.name for field in compact.fields] == COMPACT_NAMES
    assert compact.point_step == 25
    assert (compact.height, compact.width) == (full.height, full.width)
    assert compact.header == full.header
    for name in COMPACT_NAMES:
        np.testing.assert_array_equal(column(compact, name), column(full, name))
    is_without = np.arange(NUM_POINTS) == 4
    for name in ("x", "flow_x", "vx", "confidence"):
        np.testing.assert_array_equal(np.isnan(column(full, name)), is_without)
    assert not column(full, "dynamic")[4]
    assert [field.name for field in full.fields][:-1] == [f.name for f in colorless.fields]
    assert (full.fields[-1].name, full.fields[-1].datatype) == ("rgb", PointField.FLOAT32)


def test_a_field_of_the_sensor_is_renamed_only_for_a_column_of_the_layout():
    columns = dict(zip("xyz", surfaces(0, NUM_POINTS).T.copy(), strict=True))
    columns |= {name: np.full(NUM_POINTS, 99.0, np.float32) for name in ADDED_FIELDS}
    message = cloud_message(columns, stamp_ns=10**9)
    sweep = CloudReader().sweep(message, Settings().time, 0)
    flow, colorless = (
        deserialize_message(flow_cloud(sweep, made_estimate(NUM_POINTS), 0.1, layout), PointCloud2)
        for layout in (FULL_LAYOUT.output, COLORLESS.output)
    )
    names = [f"sensor_{name}" for name in ADDED_FIELDS]
    assert [field.name for field in flow.fields] == ["x", "y", "z", *names, *ADDED_FIELDS]
    assert all((column(flow, name) == 99.0).all() for name in names)
    assert "sensor_rgb" not in [field.name for field in colorless.fields]


@pytest.mark.parametrize("layout", ["full", "compact"])
def test_points_of_movers_are_where_they_were_at_the_stamp_if_asked_for(clouds, layout):
    clouds.hear(MOVING)
    settings = Settings().changed({"output.layout": layout})
    (measured,) = clouds.publish(MOVING, settings=settings)
    (moved,) = clouds.publish(MOVING, settings=settings.changed({"output.deskew_movers": True}))
    # The sensor is at rest.
    times_s = TIMES_NS[np.arange(NUM_POINTS) != 4][::10] / 1e9
    shifts = times_s[:, None] * np.arange(3 * (NUM_POINTS - 1)).reshape(-1, 3)[::10] / 0.1
    for axis, name in enumerate("xyz"):
        before = column(measured, name)
        np.testing.assert_allclose(column(moved, name), before - shifts[:, axis], atol=1e-3)
        if layout == "full":
            np.testing.assert_array_equal(column(moved, f"sensor_{name}"), before)
    np.testing.assert_allclose(column(moved, "flow_x"), column(measured, "flow_x"), atol=1e-3)


def test_predicted_ground_is_published_as_a_cloud_of_its_sweep(clouds, built):
    clouds.hear(PREDICTED)
    moving = made_estimate(
        objects=[tracked(5, velocity=np.array([0.0, 8.0, 0.0]))], has_tracks=True
    )
    (far,) = clouds.publish(PREDICTED, estimate=moving)
    near_settings = Settings().changed({"output.horizon_s": 0.5})
    (near,) = clouds.publish(PREDICTED, estimate=moving, settings=near_settings)
    assert far.header == near.header == triplet().current.source.message.header
    assert [field.name for field in far.fields] == ["x", "y", "z", "ahead", "id"]
    for message, horizon_s in ((far, 2.0), (near, 0.5)):
        assert column(message, "ahead").max() == horizon_s
        assert set(column(message, "id")) == {5}
        # The middle of the car, its heading to the left, is 8 m/s further by then.
        assert column(message, "y").max() > -2 + 8 * horizon_s + 2
    # Without objects it is empty, so that listeners forget those before.
    (nothing,) = clouds.publish(PREDICTED, estimate=made_estimate(has_tracks=True))
    assert nothing.width == 0
    assert built == []


def test_costmaps_keep_what_they_have_while_the_ego_motion_is_lost(clouds):
    clouds.hear(OBJECTS, PREDICTED, CLEARING)
    of_costmaps = (PREDICTED, CLEARING)
    hidden = [tracked(5, num_points=0)]
    known = made_estimate(objects=hidden, has_tracks=True)
    clouds.publish(OBJECTS, *of_costmaps, estimate=known)
    for _ in range(3):
        lost = made_estimate(objects=hidden, has_tracks=True, lost="clouds repeat")
        (objects,) = clouds.publish(OBJECTS, estimate=lost)
        assert column(objects, "num_points").tolist() == [0]
    clouds.publish(OBJECTS, *of_costmaps, estimate=known)
    assert [len(clouds.heard[topic]) for topic in (OBJECTS, *of_costmaps)] == [5, 2, 2]


def test_objects_have_the_header_of_their_sweep_until_they_are_gone(clouds):
    clouds.hear(OBJECTS, MARKERS)
    cloud, markers = clouds.publish(
        OBJECTS, MARKERS, estimate=made_estimate(objects=[tracked(5)], has_tracks=True)
    )
    header = triplet().current.source.message.header
    assert cloud.header == header
    assert column(cloud, "id").tolist() == [5]
    assert all(marker.header == header for marker in markers.markers)
    # A method without tracks has none to publish.
    clouds.publish()
    cloud, markers = clouds.publish(OBJECTS, MARKERS, estimate=made_estimate(has_tracks=True))
    assert cloud.width == 0
    assert [marker.action for marker in markers.markers] == [Marker.DELETEALL]
    assert len(clouds.heard[OBJECTS]) == 2
