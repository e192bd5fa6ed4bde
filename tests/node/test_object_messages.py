# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages of objects: cloud, markers, and those of other packages."""

import sys
from functools import partial

import numpy as np
import pytest
import visualization_msgs.msg
from builtin_interfaces.msg import Time
from public_messages import AUTOWARE, NAV2, VISION, Package
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from synthetic_clouds import column, tracked
from visualization_msgs.msg import Marker

from mnsf_ros.node.object_messages import installed_messages, objects_cloud
from mnsf_ros.sweeps_io.flow_columns import OBJECT_ROW
from mnsf_ros.sweeps_io.object_markers import objects_markers

HEADER = Header(frame_id="lidar", stamp=Time(sec=3, nanosec=5))
markers_of = partial(objects_markers, visualization_msgs.msg, HEADER)


def objects_message(objects):
    return deserialize_message(objects_cloud(HEADER, objects), PointCloud2)


class TestCloud:
    def test_has_a_point_for_each_object(self):
        message = objects_message([tracked(3), tracked(8, num_points=0)])
        assert message.header == HEADER
        assert (message.height, message.width, message.is_dense) == (1, 2, True)
        names = [field.name for field in message.fields]
        assert names == list(OBJECT_ROW.names)
        assert column(message, "id").tolist() == [3, 8]
        assert column(message, "num_points").tolist() == [120, 0]
        assert column(message, "vy").tolist() == [5, 5]
        np.testing.assert_allclose(column(message, "cov_vy_vy"), 0.2, rtol=1e-6)


def turn_of(marker):
    turn = marker.pose.orientation
    return Rotation.from_quat([turn.x, turn.y, turn.z, turn.w])


class TestMarkers:
    def test_of_an_object(self):
        first, *shown = markers_of([tracked(4)]).markers
        assert first.action == Marker.DELETEALL
        markers = {marker.ns: marker for marker in shown}
        assert set(markers) == {"box", "velocity", "label"}
        for marker in markers.values():
            assert (marker.header, marker.id, marker.action) == (HEADER, 4, Marker.ADD)
            assert marker.lifetime.sec > 0
            assert marker.color.a > 0
        box, arrow, label = markers["box"], markers["velocity"], markers["label"]
        assert box.type == Marker.CUBE
        assert (box.scale.x, box.scale.y, box.scale.z) == (4.0, 1.8, 1.5)
        np.testing.assert_allclose(turn_of(box).apply([1, 0, 0]), [0, 1, 0], atol=1e-12)
        for marker in (box, arrow):
            place = marker.pose.position
            assert (place.x, place.y, place.z) == (10.0, -2.0, 0.5)
        assert arrow.type == Marker.ARROW
        assert arrow.scale.x == 5.0
        assert (label.type, label.text) == (Marker.TEXT_VIEW_FACING, "4: 5.0 m/s")
        assert label.pose.position.z > 0.5 + 1.5 / 2

    def test_of_objects_that_are_only_predicted_look_so(self):
        seen, predicted = (
            {marker.ns: marker for marker in markers_of([item]).markers[1:]}
            for item in (tracked(4), tracked(4, num_points=0))
        )
        assert predicted["label"].text == "4: 5.0 m/s, predicted"
        assert predicted["box"].color.a < seen["box"].color.a / 2

    @pytest.mark.parametrize("velocity", [(3.0, -4.0, 0.0), (-1.0, 0.5, 2.0), (0.0, 0.0, -1.0)])
    def test_arrow_points_where_the_object_goes(self, velocity):
        message = objects_markers(
            visualization_msgs.msg, HEADER, [tracked(velocity=np.array(velocity))]
        )
        (arrow,) = (marker for marker in message.markers if marker.ns == "velocity")
        along = turn_of(arrow).apply([arrow.scale.x, 0, 0])
        np.testing.assert_allclose(along, velocity, atol=1e-9)

    def test_have_an_extent_also_if_the_object_has_none(self):
        nothing = tracked(size=np.zeros(3), velocity=np.zeros(3))
        for marker in markers_of([nothing]).markers[1:]:
            if marker.type != Marker.TEXT_VIEW_FACING:
                assert min(marker.scale.x, marker.scale.y, marker.scale.z) > 0


# States of nav2_dynamic_msgs, which was never released.
COVARIANCES = "float64[9] position_covariance\nfloat64[9] velocity_covariance\n"
NAV2_STATES = {
    "published": NAV2["Obstacle"],
    "before covariances": NAV2["Obstacle"].replace(COVARIANCES, ""),
    "with orientation": NAV2["Obstacle"] + "geometry_msgs/Quaternion orientation\n",
}


def is_of_sweep(message):
    stamp, wanted = message.header.stamp, HEADER.stamp
    return (stamp.sec, stamp.nanosec, message.header.frame_id) == (
        *(wanted.sec, wanted.nanosec),
        HEADER.frame_id,
    )


def xyz(vector):
    return vector.x, vector.y, vector.z


@pytest.fixture
def messages_by_topic(monkeypatch):
    """Function: the messages of objects by topic, as received, where a package is installed."""

    def make(name, definitions, objects):
        for other in ("autoware_perception_msgs", "nav2_dynamic_msgs", "vision_msgs"):
            monkeypatch.setitem(sys.modules, f"{other}.msg", None)
        assert list(installed_messages()) == []
        package = Package(name, definitions)
        monkeypatch.setitem(sys.modules, f"{name}.msg", package.messages)
        return {
            topic: package.sent(maker(HEADER, objects)) for topic, _, maker in installed_messages()
        }

    return make


def test_messages_of_autoware(messages_by_topic):
    outline = np.array([(2.0, 0.5), (-1.5, 0.75), (-2.0, -0.5)])
    objects = [
        *(tracked(1), tracked(2, yaw=np.pi), tracked(3, num_points=0)),
        tracked(4, outline=outline),
    ]
    messages = messages_by_topic("autoware_perception_msgs", AUTOWARE, objects)
    assert all(is_of_sweep(message) for message in messages.values())
    tracks, detections = messages["~/objects/autoware"], messages["~/objects/autoware/detected"]
    assert len({bytes(item.object_id.uuid) for item in tracks.objects}) == 4
    assert not any(item.kinematics.is_stationary for item in tracks.objects)
    assert [item.existence_probability for item in tracks.objects] == [1, 1, 0.5, 1]
    assert_in_autoware(*tracks.objects[:2])
    # Only what is seen at present is detected.
    *boxes, seen = detections.objects
    assert_in_autoware(*boxes)
    assert seen.shape.type == seen.shape.POLYGON
    corners = [(corner.x, corner.y) for corner in seen.shape.footprint.points]
    np.testing.assert_array_equal(corners, outline)
    for state in (item.kinematics for item in detections.objects):
        assert state.has_position_covariance
        assert state.has_twist
        assert state.has_twist_covariance


def assert_in_autoware(first, second):
    corners = [(corner.x, corner.y) for corner in first.shape.footprint.points]
    np.testing.assert_allclose(corners, [(2, 0.9), (-2, 0.9), (-2, -0.9), (2, -0.9)], rtol=1e-6)
    assert first.classification[0].label == 0
    assert xyz(first.shape.dimensions) == (4.0, 1.8, 1.5)
    state = first.kinematics
    assert xyz(state.pose_with_covariance.pose.position) == (10.0, -2.0, 0.5)
    pose = np.reshape(state.pose_with_covariance.covariance, (6, 6))
    np.testing.assert_allclose(np.diag(pose)[:3], [0.01, 0.02, 0.03])
    # Ahead and to the right in the axes of the object itself.
    for found, ahead, right, variances in (
        (first, 5.0, 0.0, (0.2, 0.1, 0.3)),
        (second, 0.0, 5.0, (0.1, 0.2, 0.3)),
    ):
        twist = found.kinematics.twist_with_covariance
        assert twist.twist.linear.x == pytest.approx(ahead, abs=1e-12)
        assert twist.twist.linear.y == pytest.approx(-right, abs=1e-12)
        assert twist.twist.angular.z == 0.3
        covariance = np.reshape(twist.covariance, (6, 6))
        np.testing.assert_allclose(np.diag(covariance)[:3], variances, atol=1e-12)


@pytest.mark.parametrize("state", NAV2_STATES)
def test_message_of_nav2(messages_by_topic, state):
    objects = [tracked(1), tracked(2, yaw=np.pi / 4, num_points=0)]
    definitions = NAV2 | {"Obstacle": NAV2_STATES[state]}
    messages = messages_by_topic("nav2_dynamic_msgs", definitions, objects)
    message = messages["~/objects/nav2"]
    assert is_of_sweep(message)
    first, second = message.obstacles
    assert (first.score, second.score) == (1.0, 0.5)
    assert bytes(first.uuid.uuid) != bytes(second.uuid.uuid)
    assert xyz(first.position) == (10.0, -2.0, 0.5)
    assert xyz(first.velocity) == (0.0, 5.0, 0.0)
    if state == "with orientation":
        assert xyz(first.size) == (4.0, 1.8, 1.5)
        assert first.orientation.z == pytest.approx(np.sin(np.pi / 4))
        return
    # Along the axes of the sensor.
    assert xyz(first.size) == pytest.approx((1.8, 4.0, 1.5))
    assert second.size.x == pytest.approx((4.0 + 1.8) / np.sqrt(2))
    if state == "published":
        assert np.reshape(first.position_covariance, (3, 3))[1, 1] == 0.02
        assert np.reshape(first.velocity_covariance, (3, 3))[1, 1] == 0.2


def test_message_of_vision(messages_by_topic):
    objects = [tracked(1), tracked(2, yaw=np.pi, num_points=0)]
    message = messages_by_topic("vision_msgs", VISION, objects)["~/objects/detections"]
    assert is_of_sweep(message)
    first, second = message.detections
    assert (first.id, second.id) == ("1", "2")
    assert is_of_sweep(first)
    assert xyz(first.bbox.size) == (4.0, 1.8, 1.5)
    assert second.bbox.center.orientation.z == pytest.approx(1.0)
    (result,) = first.results
    assert result.pose.pose == first.bbox.center
    assert xyz(result.pose.pose.position) == (10.0, -2.0, 0.5)
    scores = [item.results[0].hypothesis.score for item in message.detections]
    assert (result.hypothesis.class_id, scores) == ("dynamic", [1.0, 0.5])
    pose = np.reshape(result.pose.covariance, (6, 6))
    np.testing.assert_allclose(np.diag(pose)[:3], [0.01, 0.02, 0.03])
