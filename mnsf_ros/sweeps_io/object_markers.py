# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracked objects as markers for viewers."""

import math
from collections.abc import Sequence
from typing import Any, Final, TypeAlias

from scipy.spatial.transform import Rotation

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.drawing.color_wheel import object_color

# Of packages unknown to a type checker: a module of messages, and a message.
Messages: TypeAlias = Any
Message: TypeAlias = Any

# A node that ends must not leave objects behind.
_LIFETIME_S: Final = 2
_SMALLEST_M: Final = 0.01  # viewers refuse markers without an extent
_TEXT_HEIGHT_M: Final = 0.7


def objects_markers(
    messages: Messages, header: Message, objects: Sequence[TrackedObject]
) -> Message:
    """Returns boxes, arrows of one second of motion, and labels, in place of all earlier ones.

    Objects that are only predicted are fainter, and their labels say so.

    Args:
        messages: visualization_msgs.msg, or `Messages` of that package.
        header: Of the sweep.
        objects: Its objects.
    """
    markers = [messages.Marker(header=header, action=messages.Marker.DELETEALL)]
    for item in objects:
        made = (_box(messages, item), _arrow(messages, item), _label(messages, item))
        for marker in made:
            marker.header = header
        markers += made
    return messages.MarkerArray(markers=markers)


def set_yaw(orientation: Message, yaw: float) -> None:
    """Sets a geometry_msgs/Quaternion to a turn about z, radians."""
    orientation.z, orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)


def _box(messages: Messages, item: TrackedObject) -> Message:
    marker = _marker(messages, item, "box", messages.Marker.CUBE)
    marker.color.a = 0.4 if item.num_points else 0.15
    set_yaw(marker.pose.orientation, item.yaw)
    marker.scale.x, marker.scale.y, marker.scale.z = (
        max(float(extent), _SMALLEST_M) for extent in item.size
    )
    return marker


def _arrow(messages: Messages, item: TrackedObject) -> Message:
    marker = _marker(messages, item, "velocity", messages.Marker.ARROW)
    x, y, z = item.velocity.tolist()
    pitch, yaw = -math.atan2(z, math.hypot(x, y)), math.atan2(y, x)
    turn = marker.pose.orientation
    turn.x, turn.y, turn.z, turn.w = Rotation.from_euler("ZY", (yaw, pitch)).as_quat().tolist()
    marker.scale.x = max(math.hypot(x, y, z), _SMALLEST_M)
    marker.scale.y = marker.scale.z = 0.2
    return marker


def _label(messages: Messages, item: TrackedObject) -> Message:
    marker = _marker(messages, item, "label", messages.Marker.TEXT_VIEW_FACING)
    marker.text = f"{item.track_id}: {math.hypot(*item.velocity.tolist()):.1f} m/s"
    marker.text += "" if item.num_points else ", predicted"
    marker.pose.position.z += float(item.size[2]) / 2 + _TEXT_HEIGHT_M
    marker.scale.z = _TEXT_HEIGHT_M
    return marker


def _marker(messages: Messages, item: TrackedObject, name: str, shape: int) -> Message:
    """A marker in the middle of the object, in its colour, without an extent."""
    kind = messages.Marker
    marker = kind(ns=name, id=item.track_id, type=shape, action=kind.ADD)
    marker.lifetime.sec = _LIFETIME_S
    marker.pose.orientation.w = 1.0
    place, color = marker.pose.position, marker.color
    place.x, place.y, place.z = item.center.tolist()
    color.r, color.g, color.b = object_color(item.track_id)
    color.a = 1.0
    return marker
