"""Tracked objects -> the messages of Autoware and of nav2, where those packages are installed."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from typing import Any, Final, TypeAlias
from uuid import UUID, uuid4, uuid5

import numpy as np
from numpy.typing import NDArray
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.ego_motion.covariance import UNKNOWN_COVARIANCE
from mnsf_ros.node.object_messages import set_yaw

Objects: TypeAlias = Sequence[TrackedObject]
# Of packages that a type checker cannot know: a module of messages, and one of them.
Messages: TypeAlias = Any
Message: TypeAlias = Any
MessageMaker: TypeAlias = Callable[[Header, Objects], Message]


def planner_messages() -> Iterator[tuple[str, type[Message], MessageMaker]]:
    """Yields topic, message type and maker of each package of `_PACKAGES` that is installed."""
    run = uuid4()
    for topic, (package, name, make) in _PACKAGES.items():
        try:
            messages = importlib.import_module(f"{package}.msg")
            message_type = getattr(messages, name)
        except (ImportError, AttributeError):
            continue
        yield topic, message_type, partial(make, messages, run)


def autoware_objects(messages: Messages, run: UUID, header: Header, objects: Objects) -> Message:
    """Returns an autoware_perception_msgs/TrackedObjects; twists are in the axes of the objects.

    Args:
        messages: The module autoware_perception_msgs.msg.
        run: Of this process: numbers of objects begin anew in the next one.
        header: Of the cloud that the objects were seen in.
        objects: The objects.
    """
    message = messages.TrackedObjects(header=header)
    message.objects = [_autoware_object(messages, item, run) for item in objects]
    return message


def nav2_obstacles(messages: Messages, run: UUID, header: Header, objects: Objects) -> Message:
    """Returns a nav2_dynamic_msgs/ObstacleArray; the arguments are those of `autoware_objects`."""
    message = messages.ObstacleArray(header=header)
    message.obstacles = [_nav2_obstacle(messages, item, run) for item in objects]
    return message


# Topic to package, message and what fills it.
_PACKAGES: Final = {
    "~/objects/autoware": ("autoware_perception_msgs", "TrackedObjects", autoware_objects),
    "~/objects/nav2": ("nav2_dynamic_msgs", "ObstacleArray", nav2_obstacles),
}


def _autoware_object(messages: Messages, item: TrackedObject, run: UUID) -> Message:
    found = messages.TrackedObject()
    found.object_id.uuid = _uuid(item, run)
    found.existence_probability = 1.0
    found.classification = [
        messages.ObjectClassification(label=messages.ObjectClassification.UNKNOWN, probability=1.0)
    ]
    shape, size = found.shape, found.shape.dimensions
    shape.type = messages.Shape.BOUNDING_BOX
    size.x, size.y, size.z = item.size.tolist()
    state = found.kinematics
    state.orientation_availability = messages.TrackedObjectKinematics.AVAILABLE
    pose, twist = state.pose_with_covariance, state.twist_with_covariance
    place, speed = pose.pose.position, twist.twist.linear
    place.x, place.y, place.z = item.center.tolist()
    set_yaw(pose.pose.orientation, item.yaw)
    object_from_sensor = _turn(-item.yaw)
    speed.x, speed.y, speed.z = (object_from_sensor @ item.velocity).tolist()
    pose.covariance = _in_six(item.covariance[:3, :3])
    of_speed = object_from_sensor @ item.covariance[3:, 3:] @ object_from_sensor.T
    twist.covariance = _in_six(of_speed)
    return found


def _nav2_obstacle(messages: Messages, item: TrackedObject, run: UUID) -> Message:
    found = messages.Obstacle(score=1.0)
    found.uuid.uuid = _uuid(item, run)
    place, speed, size = found.position, found.velocity, found.size
    place.x, place.y, place.z = item.center.tolist()
    speed.x, speed.y, speed.z = item.velocity.tolist()
    if hasattr(found, "orientation"):
        # Newer releases: the size is along the box.
        size.x, size.y, size.z = item.size.tolist()
        set_yaw(found.orientation, item.yaw)
    else:
        size.x, size.y, size.z = (np.abs(_turn(item.yaw)) @ item.size).tolist()
    if hasattr(found, "velocity_covariance"):
        found.position_covariance = item.covariance[:3, :3].ravel()
        found.velocity_covariance = item.covariance[3:, 3:].ravel()
    return found


def _uuid(item: TrackedObject, run: UUID) -> NDArray[np.uint8]:
    return np.frombuffer(uuid5(run, str(item.track_id)).bytes, np.uint8)


def _turn(yaw: float) -> NDArray[np.float64]:
    """(3, 3) rotation about z, radians."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])


def _in_six(covariance: NDArray[np.float64]) -> NDArray[np.float64]:
    """(36,) of a pose or twist: (3, 3) of its linear part, its angular part unknown."""
    full = UNKNOWN_COVARIANCE.copy()
    full[:3, :3] = covariance
    return full.ravel()
