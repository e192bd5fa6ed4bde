"""Tracked objects -> messages of common_interfaces: a table of them, and a picture."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any, Final

from scipy.spatial.transform import Rotation
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from visualization_msgs.msg import Marker, MarkerArray

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.core.object_columns import object_columns
from mnsf_ros.drawing.color_wheel import object_color
from mnsf_ros.node.cloud_messages import encoded_message
from msg_utils.point_cloud2 import encode_columns

# A viewer that misses a deletion, or a node that ends, must not leave objects behind.
_LIFETIME_S: Final = 2
_NAMESPACES: Final = ("box", "velocity", "label")
_SMALLEST_M: Final = 0.01  # viewers refuse markers without an extent
_TEXT_HEIGHT_M: Final = 0.7


def objects_message(header: Header, objects: Sequence[TrackedObject]) -> PointCloud2:
    """Returns a cloud of one row, with one point for each object and the fields OBJECT_COLUMNS."""
    return encoded_message(
        header, encode_columns(object_columns(objects), 1, len(objects)), is_dense=True
    )


def set_yaw(orientation: Any, yaw: float) -> None:  # noqa: ANN401 - of any package of messages
    """Sets a geometry_msgs/Quaternion to a turn about z, radians."""
    orientation.z, orientation.w = math.sin(yaw / 2), math.cos(yaw / 2)


class ObjectMarkers:
    """Makes boxes, arrows of one second of motion, and labels; deletes those of objects gone."""

    def __init__(self) -> None:
        self._shown: frozenset[int] = frozenset()

    def message(self, header: Header, objects: Sequence[TrackedObject]) -> MarkerArray:
        """Returns the markers of the objects of a sweep, and the ends of those shown before."""
        shown = frozenset(item.track_id for item in objects)
        markers = [
            Marker(header=header, ns=name, id=track_id, action=Marker.DELETE)
            for track_id in sorted(self._shown - shown)
            for name in _NAMESPACES
        ]
        for item in objects:
            markers += [_box(header, item), _arrow(header, item), _label(header, item)]
        self._shown = shown
        return MarkerArray(markers=markers)


def _box(header: Header, item: TrackedObject) -> Marker:
    marker = _marker(header, item, "box", Marker.CUBE)
    marker.color.a = 0.4
    set_yaw(marker.pose.orientation, item.yaw)
    marker.scale.x, marker.scale.y, marker.scale.z = (
        max(float(extent), _SMALLEST_M) for extent in item.size
    )
    return marker


def _arrow(header: Header, item: TrackedObject) -> Marker:
    marker = _marker(header, item, "velocity", Marker.ARROW)
    x, y, z = item.velocity.tolist()
    pitch, yaw = -math.atan2(z, math.hypot(x, y)), math.atan2(y, x)
    turn = marker.pose.orientation
    turn.x, turn.y, turn.z, turn.w = Rotation.from_euler("ZY", (yaw, pitch)).as_quat().tolist()
    marker.scale.x = max(math.hypot(x, y, z), _SMALLEST_M)
    marker.scale.y = marker.scale.z = 0.2
    return marker


def _label(header: Header, item: TrackedObject) -> Marker:
    marker = _marker(header, item, "label", Marker.TEXT_VIEW_FACING)
    marker.text = f"{item.track_id}: {math.hypot(*item.velocity.tolist()):.1f} m/s"
    marker.pose.position.z += float(item.size[2]) / 2 + _TEXT_HEIGHT_M
    marker.scale.z = _TEXT_HEIGHT_M
    return marker


def _marker(header: Header, item: TrackedObject, name: str, shape: int) -> Marker:
    """A marker in the middle of the object, in its colour, without an extent."""
    marker = Marker(header=header, ns=name, id=item.track_id, type=shape, action=Marker.ADD)
    marker.lifetime.sec = _LIFETIME_S
    place, color = marker.pose.position, marker.color
    place.x, place.y, place.z = item.center.tolist()
    color.r, color.g, color.b = object_color(item.track_id)
    color.a = 1.0
    return marker
