# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Types of messages with clouds; clouds in others than PointCloud2: compressed, of Livox."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from msg_utils.cloud_layout import PointCloudLike
from msg_utils.errors import MessageError, describe
from msg_utils.expansion import MAX_BYTES, expanded
from msg_utils.point_cloud2 import encode_columns

CLOUD_TYPE: Final = "sensor_msgs/msg/PointCloud2"
COMPRESSED_TYPE: Final = "point_cloud_interfaces/msg/CompressedPointCloud2"
# Of Livox's drivers for ROS 2, their predecessor, and that for ROS 1: the same message.
_LIVOX: Final = ("livox_ros_driver2", "livox_interfaces", "livox_ros_driver")
LIVOX_TYPES: Final = tuple(f"{package}/msg/CustomMsg" for package in _LIVOX)

_COMPRESSED: Final = """
std_msgs/Header header
uint32 height
uint32 width
sensor_msgs/PointField[] fields
bool is_bigendian
uint32 point_step
uint32 row_step
uint8[] compressed_data
bool is_dense
string format
"""
_CUSTOM_MSG: Final = """
std_msgs/Header header
uint64 timebase
uint32 point_num
uint8 lidar_id
uint8[3] rsvd
CustomPoint[] points
"""
_CUSTOM_POINT: Final = """
uint32 offset_time
float32 x
float32 y
float32 z
uint8 reflectivity
uint8 tag
uint8 line
"""
# Type of a message, or of a part of one, to its definition.
DEFINITIONS: Final[Mapping[str, str]] = {
    COMPRESSED_TYPE: _COMPRESSED,
    **{f"{package}/msg/CustomMsg": _CUSTOM_MSG for package in _LIVOX},
    **{f"{package}/msg/CustomPoint": _CUSTOM_POINT for package in _LIVOX},
}

# Field of the cloud to its type, in the order of a CustomPoint.
_LIVOX_POINT: Final = {
    "offset_time": np.uint32,
    **dict.fromkeys("xyz", np.float32),
    **dict.fromkeys(("intensity", "tag", "line"), np.uint8),
}

# What the data of Cloudini begins with: its publisher leaves `format` empty.
_CLOUDINI: Final = b"CLOUDINI_V"


class UnsupportedCloudError(MessageError):
    """Clouds of this kind cannot be read, however intact; the text says what to do."""


@dataclass(frozen=True, eq=False)
class Cloud:
    """A cloud with the attributes of sensor_msgs/PointCloud2."""

    header: Any
    height: int
    width: int
    fields: Any
    is_bigendian: bool
    point_step: int
    row_step: int
    data: Any
    is_dense: bool


def as_cloud(message: Any) -> PointCloudLike:  # noqa: ANN401 - a message of any package
    """Returns a PointCloud2 as it is, and the cloud in any other of these messages.

    Raises:
        UnsupportedCloudError: It is compressed in a way that cannot be read.
        MessageError: Its compressed data is damaged, or expands to more than its points.
    """
    if hasattr(message, "compressed_data"):
        return _decompressed(message)
    return _livox_cloud(message) if hasattr(message, "timebase") else message


def _decompressed(message: Any) -> Cloud:  # noqa: ANN401
    data, form = bytes(message.compressed_data), message.format
    if data.startswith(_CLOUDINI):
        form = "cloudini"
    if form == "draco":
        raise UnsupportedCloudError(
            "clouds of the format draco lose equal points and their order: take the topic of the "
            "transport zstd, zlib, cloudini or raw"
        )
    if form not in ("zstd", "zlib", "cloudini"):
        expected = "expected zstd, zlib or cloudini"
        raise UnsupportedCloudError(f"clouds have the format {describe(form)}, {expected}")
    is_bigendian, row_step = bool(message.is_bigendian), message.row_step
    row_bytes = message.width * message.point_step
    if message.height * row_bytes == 0:
        data = b""  # some write nothing then
    elif form == "cloudini":
        data = _of_cloudini(data, message)
        is_bigendian, row_step = False, row_bytes
    else:
        try:
            max_bytes = min(MAX_BYTES, message.height * max(row_bytes, row_step))
            data = expanded(data, form, max_bytes)
        except Exception as error:  # noqa: BLE001 - each library has its own
            raise MessageError(f"compressed data ({form}) is damaged: {error}") from None
    return Cloud(
        message.header,
        message.height,
        message.width,
        message.fields,
        is_bigendian,
        message.point_step,
        row_step,
        data,
        message.is_dense,
    )


def _of_cloudini(data: bytes, message: Any) -> bytes:  # noqa: ANN401
    try:
        from pureini import _pureini
    except ImportError:
        text = "clouds of the format cloudini need the Python library pureini: pip install pureini"
        raise UnsupportedCloudError(text) from None
    expected = message.width, message.height, message.point_step
    try:
        # Before memory is taken for what it claims.
        claimed, _ = _pureini.decode_header(data)
        found = claimed.width, claimed.height, claimed.point_step
        if found == expected and np.prod(found, dtype=object) <= MAX_BYTES:
            points, _ = _pureini.PointcloudDecoder().decode(data)
            return bytes(points)
    except Exception as error:  # noqa: BLE001 - a RuntimeError, for one
        raise MessageError(f"compressed data (cloudini) is damaged: {error}") from None
    raise MessageError(
        f"compressed data (cloudini) has width, height and point_step {found}, expected "
        f"{expected}, and at most {MAX_BYTES} bytes"
    )


def _livox_cloud(message: Any) -> Cloud:  # noqa: ANN401
    names = ("offset_time", *"xyz", "reflectivity", "tag", "line")
    rows = (tuple(getattr(point, name) for name in names) for point in message.points)
    points = np.fromiter(rows, np.dtype([*_LIVOX_POINT.items()]), len(message.points))
    cloud = encode_columns({name: points[name] for name in _LIVOX_POINT}, 1, len(points))
    return Cloud(
        message.header,
        cloud.height,
        cloud.width,
        cloud.fields,
        cloud.is_bigendian,
        cloud.point_step,
        cloud.row_step,
        cloud.data,
        is_dense=True,
    )
