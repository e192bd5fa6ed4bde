# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds as a broken driver or an attacker sends them, made from a good one."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField

_LENGTHS: Final = (2**31, 2**32 - 1, 2**31 - 1, 65_536, 7, 0)
_COORDINATES: Final = (np.nan, np.inf, -np.inf, 3e38, -3e38, 1e30, 1e6, 1e-45, 0.0)
_NAMES: Final = ("", "x", "rgb", "t", "dynamic", "flow_x", "\u2603" * 50, "a" * 10_000)

Random = np.random.Generator


def _of(values: tuple[Any, ...], random: Random) -> Any:  # noqa: ANN401 - one of whatever they are
    return values[int(random.integers(len(values)))]


def _sizes(message: PointCloud2, random: Random) -> None:
    name = _of(("height", "width", "point_step", "row_step"), random)
    setattr(message, name, int(_of((*_LENGTHS, int(random.integers(2**32))), random)))


def _field(message: PointCloud2, random: Random) -> None:
    field = message.fields[int(random.integers(len(message.fields)))]
    name, values = _of(
        (
            ("datatype", (0, 1, 5, 6, 8, 9, 255)),
            ("offset", (1, 3, 2**31, 2**32 - 1, message.point_step)),
            ("count", (0, 2, 2**31, 2**32 - 1)),
            ("name", _NAMES),
        ),
        random,
    )
    setattr(field, name, _of(values, random))


def _fields(message: PointCloud2, random: Random) -> None:
    number = _of((0, 1, 2, 500), random)
    known = list(message.fields)
    message.fields = [known[int(random.integers(len(known)))] for _ in range(number)]


def _field_of_times(message: PointCloud2, random: Random) -> None:
    datatype = _of((PointField.FLOAT32, PointField.UINT32, PointField.INT8), random)
    name = _of(("t", "time", "timestamp", "offset_time"), random)
    message.fields.append(PointField(name=name, offset=0, datatype=datatype, count=1))


def _data(message: PointCloud2, random: Random) -> None:
    data = bytes(message.data)
    message.data = _of((b"", data[:-1], data[: len(data) // 2], data + b"x", data * 2), random)


def _coordinates(message: PointCloud2, random: Random) -> None:
    points = np.frombuffer(bytes(message.data), np.float32).reshape(message.width, -1).copy()
    rows = random.random(len(points)) < _of((0.01, 0.5, 1.0), random)
    points[rows, int(random.integers(3))] = _of(_COORDINATES, random)
    message.data = points.tobytes()


def _few_points(message: PointCloud2, random: Random) -> None:
    message.width = int(_of((0, 1, 2, 10), random))
    message.row_step = message.width * message.point_step
    message.data = bytes(message.data)[: message.row_step]


def _one_place(message: PointCloud2, random: Random) -> None:
    points = np.frombuffer(bytes(message.data), np.float32).reshape(message.width, -1).copy()
    points[:, :3] = _of(_COORDINATES, random)
    message.data = points.tobytes()


def _stamp(message: PointCloud2, random: Random) -> None:
    message.header.stamp.sec = int(_of((0, -1, -(2**31), 2**31 - 1, 5), random))
    message.header.stamp.nanosec = int(_of((0, 10**9, 2**32 - 1), random))


def _frame(message: PointCloud2, random: Random) -> None:
    message.header.frame_id = _of(("", "other", "\u2603", "/" * 300, "f" * 100_000), random)


def _order_of_bytes(message: PointCloud2, _random: Random) -> None:
    message.is_bigendian = True


_CHANGES: Final[Mapping[str, Callable[[PointCloud2, Random], None]]] = {
    "sizes": _sizes,
    "field": _field,
    "fields": _fields,
    "field of times": _field_of_times,
    "data": _data,
    "coordinates": _coordinates,
    "few points": _few_points,
    "one place": _one_place,
    "stamp": _stamp,
    "frame": _frame,
    "order of bytes": _order_of_bytes,
}


def _flipped(raw: bytes, random: Random) -> bytes:
    data = bytearray(raw)
    for _ in range(int(random.integers(1, 9))):
        data[int(random.integers(len(data)))] ^= int(random.integers(1, 256))
    return bytes(data)


def _flipped_head(raw: bytes, random: Random) -> bytes:
    return _flipped(raw[:200], random) + raw[200:]


def _cut(raw: bytes, random: Random) -> bytes:
    return raw[: int(random.integers(len(raw)))]


def _length(raw: bytes, random: Random) -> bytes:
    place = 4 * int(random.integers(1, 50))
    return raw[:place] + int(_of(_LENGTHS, random)).to_bytes(4, "little") + raw[place + 4 :]


def _noise(_raw: bytes, random: Random) -> bytes:
    return random.bytes(int(_of((1, 4, 5, 100, 10_000), random)))


# Of the serialized message.
_DAMAGES: Final[Mapping[str, Callable[[bytes, Random], bytes]]] = {
    "flipped": _flipped,
    "flipped head": _flipped_head,
    "cut": _cut,
    "length": _length,
    "noise": _noise,
}

KINDS: Final = (*_CHANGES, *_DAMAGES)


def hostile(kind: str, good: bytes, random: Random) -> bytes:
    """Returns a serialized cloud of one of the `KINDS`, made from a serialized good one."""
    if kind in _DAMAGES:
        return _DAMAGES[kind](good, random)
    message = deserialize_message(good, PointCloud2)
    _CHANGES[kind](message, random)
    return bytes(serialize_message(message))
