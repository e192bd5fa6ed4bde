# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Serialized sensor_msgs/PointCloud2: CDR, little-endian."""

import io
import struct
from typing import Any, Final, TypeAlias

import numpy as np

from msg_utils.cloud_layout import EncodedCloud

# Any object with `stamp` and `frame_id`, as std_msgs/Header has.
HeaderLike: TypeAlias = Any

_ENCAPSULATION: Final = b"\x00\x01\x00\x00"


def serialized_cloud(header: HeaderLike, cloud: EncodedCloud, *, is_dense: bool) -> bytes:
    """Returns the serialized message of a cloud, its points written in place.

    The bytes are those of rclpy, which copies the points three times.
    """
    start, num_bytes = _before_data(header, cloud), cloud.num_bytes
    # The one way to write into the memory of a `bytes`, as publishers need it: `getvalue` does not
    # copy.
    stream = io.BytesIO()
    stream.write(start)
    stream.seek(num_bytes, io.SEEK_CUR)
    stream.write(bytes([is_dense]))
    with stream.getbuffer() as view:
        cloud.write(np.frombuffer(view, np.uint8, num_bytes, len(start)))
    return stream.getvalue()


def _before_data(header: HeaderLike, cloud: EncodedCloud) -> bytes:
    """Returns the bytes before those of the points."""
    out = bytearray()
    _append(out, "i", header.stamp.sec)
    _append(out, "I", header.stamp.nanosec)
    _append_text(out, header.frame_id)
    _append(out, "I", cloud.height)
    _append(out, "I", cloud.width)
    _append(out, "I", len(cloud.fields))
    for field in cloud.fields:
        _append_text(out, field.name)
        _append(out, "I", field.offset)
        _append(out, "B", field.datatype)
        _append(out, "I", field.count)
    _append(out, "?", cloud.is_bigendian)
    _append(out, "I", cloud.point_step)
    _append(out, "I", cloud.row_step)
    _append(out, "I", cloud.num_bytes)
    return _ENCAPSULATION + bytes(out)


def _append(out: bytearray, kind: str, value: int) -> None:
    """Appends a number at a multiple of its size."""
    out += bytes(-len(out) % struct.calcsize(kind))
    out += struct.pack(f"<{kind}", value)


def _append_text(out: bytearray, text: str) -> None:
    # As in rclpy, a string ends at its first zero.
    content = text.encode().partition(b"\0")[0] + b"\0"
    _append(out, "I", len(content))
    out += content
