# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracked objects as messages: clouds, and those of other packages if installed."""

import importlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any, Final, TypeAlias
from uuid import UUID, uuid4, uuid5

import numpy as np
from geometry_msgs.msg import Point32
from numpy.typing import NDArray
from std_msgs.msg import Header

from mnsf_ros.arrays import Floats
from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.ego_motion.covariance import UNKNOWN_COVARIANCE
from mnsf_ros.geometry.transforms import planar_pose
from mnsf_ros.sweeps_io.flow_columns import object_columns
from mnsf_ros.sweeps_io.object_markers import Message, Messages, set_yaw
from msg_utils.cdr import serialized_cloud
from msg_utils.point_cloud2 import encode_columns

# Of objects that are only predicted; of those that are seen it is 1.
_PREDICTED_SCORE: Final = 0.5

Objects: TypeAlias = Sequence[TrackedObject]
MessageMaker: TypeAlias = Callable[[Header, Objects], Message]


def objects_cloud(header: Header, objects: Objects) -> bytes:
    """Returns the serialized cloud of objects: one row, a point each, fields OBJECT_ROW."""
    return cloud_of(header, object_columns(objects))


def cloud_of(header: Header, columns: Mapping[str, NDArray[Any]]) -> bytes:
    """Returns the serialized cloud of columns (N,), x among them, in one row."""
    encoding = encode_columns(columns, 1, len(columns["x"]))
    return serialized_cloud(header, encoding, is_dense=True)


def installed_messages() -> Iterator[tuple[str, type[Message], MessageMaker]]:
    """Yields topic, message type and maker of each message of `_OPTIONAL` that is installed."""
    run = uuid4()  # numbers of objects are unique within it
    for topic, (package, name, items, make) in _OPTIONAL.items():
        try:
            messages = importlib.import_module(f"{package}.msg")
            message_type = getattr(messages, name)
        except (ImportError, AttributeError):
            continue
        yield topic, message_type, partial(_list, message_type, items, partial(make, messages, run))


def _list(
    message_type: type[Message],
    items: str,
    make: Callable[[TrackedObject], Message | None],
    header: Header,
    objects: Objects,
) -> Message:
    message = message_type(header=header)
    made = [one for item in objects if (one := make(item)) is not None]
    for item in made:
        if hasattr(item, "header"):
            item.header = header
    setattr(message, items, made)
    return message


def _autoware_tracked(messages: Messages, run: UUID, item: TrackedObject) -> Message:
    """An autoware_perception_msgs/TrackedObject."""
    found = _in_autoware(messages, messages.TrackedObject(), item)
    found.object_id.uuid = _uuid(item, run)
    found.kinematics.is_stationary = False
    return found


def _autoware_detected(messages: Messages, _run: UUID, item: TrackedObject) -> Message | None:
    """An autoware_perception_msgs/DetectedObject, with its velocity; None if it is hidden now."""
    if item.num_points == 0:
        return None
    found = _in_autoware(messages, messages.DetectedObject(), item)
    state = found.kinematics
    state.has_position_covariance = state.has_twist = state.has_twist_covariance = True
    if len(item.outline) > 2:
        found.shape.type = messages.Shape.POLYGON
        found.shape.footprint.points = _polygon(item.outline)
    return found


def _in_autoware(messages: Messages, found: Message, item: TrackedObject) -> Message:
    """What both messages share; twist and footprint are in the axes of the object."""
    found.existence_probability = _score(item)
    found.classification = [
        messages.ObjectClassification(label=messages.ObjectClassification.UNKNOWN, probability=1.0)
    ]
    shape, size = found.shape, found.shape.dimensions
    shape.type = messages.Shape.BOUNDING_BOX
    size.x, size.y, size.z = item.size.tolist()
    corners = np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * item.size[:2] / 2
    shape.footprint.points = _polygon(corners)
    state = found.kinematics
    state.orientation_availability = type(state).AVAILABLE
    pose, twist = state.pose_with_covariance, state.twist_with_covariance
    place, speed = pose.pose.position, twist.twist.linear
    place.x, place.y, place.z = item.center.tolist()
    set_yaw(pose.pose.orientation, item.yaw)
    object_from_sensor = planar_pose(0.0, 0.0, -item.yaw)[:3, :3]
    speed.x, speed.y, speed.z = (object_from_sensor @ item.velocity).tolist()
    twist.twist.angular.z = item.turn_rate
    pose.covariance = _in_six(item.covariance[:3, :3])
    of_speed = object_from_sensor @ item.covariance[3:, 3:] @ object_from_sensor.T
    twist.covariance = _in_six(of_speed)
    return found


def _polygon(corners: Floats) -> list[Point32]:
    return [Point32(x=x, y=y) for x, y in corners.tolist()]


def _nav2_obstacle(messages: Messages, run: UUID, item: TrackedObject) -> Message:
    found = messages.Obstacle(score=_score(item))
    found.uuid.uuid = _uuid(item, run)
    place, speed, size = found.position, found.velocity, found.size
    place.x, place.y, place.z = item.center.tolist()
    speed.x, speed.y, speed.z = item.velocity.tolist()
    if hasattr(found, "orientation"):
        # Newer releases: the size is along the box.
        size.x, size.y, size.z = item.size.tolist()
        set_yaw(found.orientation, item.yaw)
    else:
        turn = planar_pose(0.0, 0.0, item.yaw)[:3, :3]
        size.x, size.y, size.z = (np.abs(turn) @ item.size).tolist()
    if hasattr(found, "velocity_covariance"):
        found.position_covariance = item.covariance[:3, :3].ravel()
        found.velocity_covariance = item.covariance[3:, 3:].ravel()
    return found


def _detection(messages: Messages, _run: UUID, item: TrackedObject) -> Message:
    """A vision_msgs/Detection3D, which has no velocity."""
    hypothesis = messages.ObjectHypothesisWithPose()
    hypothesis.hypothesis.class_id, hypothesis.hypothesis.score = "dynamic", _score(item)
    hypothesis.pose.covariance = _in_six(item.covariance[:3, :3])
    found = messages.Detection3D(id=str(item.track_id), results=[hypothesis])
    for pose in (hypothesis.pose.pose, found.bbox.center):
        pose.position.x, pose.position.y, pose.position.z = item.center.tolist()
        set_yaw(pose.orientation, item.yaw)
    size = found.bbox.size
    size.x, size.y, size.z = item.size.tolist()
    return found


# Topic to package, message, its list of objects, and the maker of one object.
_OPTIONAL: Final = {
    "~/objects/autoware": (
        *("autoware_perception_msgs", "TrackedObjects", "objects"),
        _autoware_tracked,
    ),
    "~/objects/autoware/detected": (
        *("autoware_perception_msgs", "DetectedObjects", "objects"),
        _autoware_detected,
    ),
    "~/objects/detections": ("vision_msgs", "Detection3DArray", "detections", _detection),
    "~/objects/nav2": ("nav2_dynamic_msgs", "ObstacleArray", "obstacles", _nav2_obstacle),
}


def _score(item: TrackedObject) -> float:
    return 1.0 if item.num_points else _PREDICTED_SCORE


def _uuid(item: TrackedObject, run: UUID) -> NDArray[np.uint8]:
    return np.frombuffer(uuid5(run, str(item.track_id)).bytes, np.uint8)


def _in_six(covariance: Floats) -> Floats:
    """(36,) of a pose or twist: (3, 3) of its linear part, its angular part unknown."""
    full = UNKNOWN_COVARIANCE.copy()
    full[:3, :3] = covariance
    return full.ravel()
