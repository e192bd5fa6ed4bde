# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages of objects: cloud, markers, and those of other packages."""

import dataclasses
import sys
import types
from functools import partial

import numpy as np
import pytest
import visualization_msgs.msg
from geometry_msgs.msg import (
    AccelWithCovariance,
    Point,
    Polygon,
    Pose,
    PoseWithCovariance,
    Quaternion,
    TwistWithCovariance,
    Vector3,
)
from rclpy.serialization import deserialize_message
from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from synthetic_clouds import column, tracked
from unique_identifier_msgs.msg import UUID
from visualization_msgs.msg import Marker

from mnsf_ros.node.object_messages import installed_messages, objects_cloud
from mnsf_ros.sweeps_io.flow_columns import OBJECT_ROW
from mnsf_ros.sweeps_io.object_markers import objects_markers

HEADER = Header(frame_id="lidar")
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


def message_type(name, **fields):
    """A class with the fields of a definition and no others, as rosidl makes them."""
    made = [
        (field, kind, dataclasses.field(default_factory=kind)) for field, kind in fields.items()
    ]
    return dataclasses.make_dataclass(name, made, slots=True)


def autoware():
    """The definitions of autoware_perception_msgs 1.12, of classes made here."""
    messages = types.ModuleType("autoware_perception_msgs.msg")
    messages.ObjectClassification = message_type(
        "ObjectClassification", label=int, probability=float
    )
    messages.ObjectClassification.UNKNOWN = 0
    messages.Shape = message_type("Shape", type=int, footprint=Polygon, dimensions=Vector3)
    messages.Shape.BOUNDING_BOX = 0
    messages.TrackedObjectKinematics = message_type(
        "TrackedObjectKinematics",
        pose_with_covariance=PoseWithCovariance,
        twist_with_covariance=TwistWithCovariance,
        acceleration_with_covariance=AccelWithCovariance,
        orientation_availability=int,
        is_stationary=bool,
    )
    messages.TrackedObjectKinematics.AVAILABLE = 2
    messages.TrackedObject = message_type(
        "TrackedObject",
        object_id=UUID,
        existence_probability=float,
        classification=list,
        kinematics=messages.TrackedObjectKinematics,
        shape=messages.Shape,
    )
    messages.TrackedObjects = message_type("TrackedObjects", header=Header, objects=list)
    messages.DetectedObjectKinematics = message_type(
        "DetectedObjectKinematics",
        pose_with_covariance=PoseWithCovariance,
        has_position_covariance=bool,
        orientation_availability=int,
        twist_with_covariance=TwistWithCovariance,
        has_twist=bool,
        has_twist_covariance=bool,
    )
    messages.DetectedObjectKinematics.AVAILABLE = 2
    messages.DetectedObject = message_type(
        "DetectedObject",
        existence_probability=float,
        classification=list,
        kinematics=messages.DetectedObjectKinematics,
        shape=messages.Shape,
    )
    messages.DetectedObjects = message_type("DetectedObjects", header=Header, objects=list)
    return messages


# Releases of nav2_dynamic_msgs differ in these fields.
NAV2_RELEASES = {
    "first": {},
    "with covariance": {"position_covariance": list, "velocity_covariance": list},
    "with orientation": {"orientation": Quaternion},
}


def nav2(release):
    """The definitions of a release of nav2_dynamic_msgs, of classes made here."""
    messages = types.ModuleType("nav2_dynamic_msgs.msg")
    known = {"uuid": UUID, "score": float, "position": Point, "velocity": Vector3, "size": Vector3}
    messages.Obstacle = message_type("Obstacle", **known, **NAV2_RELEASES[release])
    messages.ObstacleArray = message_type("ObstacleArray", header=Header, obstacles=list)
    return messages


def vision():
    """The definitions of vision_msgs 4.1, of classes made here."""
    messages = types.ModuleType("vision_msgs.msg")
    messages.ObjectHypothesis = message_type("ObjectHypothesis", class_id=str, score=float)
    messages.ObjectHypothesisWithPose = message_type(
        "ObjectHypothesisWithPose", hypothesis=messages.ObjectHypothesis, pose=PoseWithCovariance
    )
    messages.BoundingBox3D = message_type("BoundingBox3D", center=Pose, size=Vector3)
    messages.Detection3D = message_type(
        "Detection3D", header=Header, results=list, bbox=messages.BoundingBox3D, id=str
    )
    messages.Detection3DArray = message_type("Detection3DArray", header=Header, detections=list)
    return messages


@pytest.fixture
def messages_by_topic(monkeypatch):
    """Function: the messages of objects by topic of a package, which is installed for it."""

    def make(package, messages, objects):
        for name in ("autoware_perception_msgs", "nav2_dynamic_msgs", "vision_msgs"):
            monkeypatch.setitem(sys.modules, f"{name}.msg", None)
        assert list(installed_messages()) == []
        monkeypatch.setitem(sys.modules, f"{package}.msg", messages)
        return {topic: maker(HEADER, objects) for topic, _, maker in installed_messages()}

    return make


def test_messages_of_autoware(messages_by_topic):
    objects = [tracked(1), tracked(2, yaw=np.pi), tracked(3, num_points=0)]
    messages = messages_by_topic("autoware_perception_msgs", autoware(), objects)
    assert all(message.header == HEADER for message in messages.values())
    tracks, detections = messages["~/objects/autoware"], messages["~/objects/autoware/detected"]
    assert len({bytes(item.object_id.uuid) for item in tracks.objects}) == 3
    assert not any(item.kinematics.is_stationary for item in tracks.objects)
    assert_in_autoware(*tracks.objects[:2])
    # Only what is seen at present is detected.
    assert_in_autoware(*detections.objects)
    for state in (item.kinematics for item in detections.objects):
        assert state.has_position_covariance
        assert state.has_twist
        assert state.has_twist_covariance


def assert_in_autoware(first, second):
    corners = [(corner.x, corner.y) for corner in first.shape.footprint.points]
    np.testing.assert_allclose(corners, [(2, 0.9), (-2, 0.9), (-2, -0.9), (2, -0.9)], rtol=1e-6)
    assert first.classification[0].label == 0
    assert first.shape.dimensions == Vector3(x=4.0, y=1.8, z=1.5)
    state = first.kinematics
    assert state.pose_with_covariance.pose.position == Point(x=10.0, y=-2.0, z=0.5)
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


@pytest.mark.parametrize("release", NAV2_RELEASES)
def test_message_of_nav2(messages_by_topic, release):
    objects = [tracked(1), tracked(2, yaw=np.pi / 4)]
    messages = messages_by_topic("nav2_dynamic_msgs", nav2(release), objects)
    message = messages["~/objects/nav2"]
    assert message.header == HEADER
    first, second = message.obstacles
    assert first.uuid != second.uuid
    assert first.position == Point(x=10.0, y=-2.0, z=0.5)
    assert first.velocity == Vector3(x=0.0, y=5.0, z=0.0)
    if release == "with orientation":
        assert first.size == Vector3(x=4.0, y=1.8, z=1.5)
        assert first.orientation.z == pytest.approx(np.sin(np.pi / 4))
        return
    # Along the axes of the sensor.
    assert (first.size.x, first.size.y, first.size.z) == pytest.approx((1.8, 4.0, 1.5))
    assert second.size.x == pytest.approx((4.0 + 1.8) / np.sqrt(2))
    if release == "with covariance":
        assert np.reshape(first.position_covariance, (3, 3))[1, 1] == 0.02
        assert np.reshape(first.velocity_covariance, (3, 3))[1, 1] == 0.2


def test_message_of_vision(messages_by_topic):
    objects = [tracked(1), tracked(2, yaw=np.pi)]
    message = messages_by_topic("vision_msgs", vision(), objects)["~/objects/detections"]
    assert message.header == HEADER
    first, second = message.detections
    assert (first.id, second.id, first.header) == ("1", "2", HEADER)
    assert first.bbox.size == Vector3(x=4.0, y=1.8, z=1.5)
    assert second.bbox.center.orientation.z == pytest.approx(1.0)
    (result,) = first.results
    assert result.pose.pose == first.bbox.center
    assert result.pose.pose.position == Point(x=10.0, y=-2.0, z=0.5)
    assert result.hypothesis.class_id == "dynamic"
    pose = np.reshape(result.pose.covariance, (6, 6))
    np.testing.assert_allclose(np.diag(pose)[:3], [0.01, 0.02, 0.03])
