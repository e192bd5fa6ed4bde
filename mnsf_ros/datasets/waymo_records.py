# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Waymo Open, first edition: a TFRecord file of `Frame` messages for each segment."""

from __future__ import annotations

import struct
import zlib
from functools import cache
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import reading
from mnsf_ros.datasets.waymo import (
    FRAME_ID,
    LaserCalibration,
    LaserReturns,
    shaped,
    waymo_box,
    waymo_sweep,
)
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import rigid_pose
from mnsf_ros.sweeps_io.files import require

if TYPE_CHECKING:
    from collections.abc import Iterator
    from pathlib import Path

    from numpy.typing import NDArray

_HEADER: Final = struct.Struct("<QI")
_FOOTER_BYTES: Final = 4
_CASTAGNOLI: Final = 0x82F63B78


def tf_records(path: Path) -> Iterator[bytes]:
    """Yields the records of an uncompressed file.

    The checksum of the length of a record is compared, which tells other files apart. That of its
    content is not: in Python this would take longer than all the rest.

    Raises:
        DatasetError: The file is missing, empty, cut short, or of another format.
    """
    with reading(path), path.open("rb") as file:
        index = 0
        while header := file.read(_HEADER.size):
            if len(header) < _HEADER.size:
                raise DatasetError(f"{path}: is cut short in the header of record {index}")
            length, checksum = _HEADER.unpack(header)
            if checksum != _masked_checksum(header[:8]):
                raise DatasetError(
                    f"{path}: checksum of record {index} is wrong; "
                    "it is damaged or no uncompressed TFRecord file"
                )
            record = file.read(length)
            if len(record) < length or len(file.read(_FOOTER_BYTES)) < _FOOTER_BYTES:
                raise DatasetError(f"{path}: is cut short in record {index}")
            yield record
            index += 1
    if index == 0:
        raise DatasetError(f"{path}: is empty")


def _masked_checksum(data: bytes) -> int:
    """CRC-32C, masked as in TFRecord files."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (_CASTAGNOLI if crc & 1 else 0)
    crc ^= 0xFFFFFFFF
    return (((crc >> 15) | (crc << 17)) + 0xA282EAD8) & 0xFFFFFFFF


# The messages and fields in use: number, type (* if repeated) and name of each field.
_SCHEMA: Final = {
    "Transform": "1 double* values",
    "Shape": "1 int32* dims",
    "Matrix": "1 float* data, 2 Shape shape",
    "RangeImage": "2 bytes image, 4 bytes poses",
    "Laser": "1 int32 name, 2 RangeImage first_return",
    "Calibration": "1 int32 name, 2 double* angles, 3 double low, 4 double high, 5 Transform mount",
    "Context": "3 Calibration* calibrations",
    "Box": "1 double x, 2 double y, 3 double z, 4 double width, 5 double length, 6 double height, "
    "7 double heading",
    "Label": "1 Box box, 3 int32 type, 4 string id",
    "Frame": "1 Context context, 2 int64 micros, 3 Transform pose, 5 Laser* lasers, "
    "6 Label* labels",
}


@cache
def _messages() -> dict[str, Any]:
    """Returns the classes of all messages by name."""
    factory = require("google.protobuf.message_factory", "protobuf")
    descriptors = require("google.protobuf.descriptor_pb2", "protobuf")
    file = descriptors.FileDescriptorProto(name="waymo_open.proto", package="waymo_open")
    for message, fields in _SCHEMA.items():
        descriptor = file.message_type.add(name=message)
        for number, kind, name in (text.split() for text in fields.split(", ")):
            field = descriptor.field.add(name=name, number=int(number))
            field.label = field.LABEL_REPEATED if kind.endswith("*") else field.LABEL_OPTIONAL
            if (single := kind.rstrip("*")) in _SCHEMA:
                field.type_name = f".{file.package}.{single}"
            else:
                field.type = getattr(field, f"TYPE_{single.upper()}")
    found = factory.GetMessages([file])
    return {name: found[f"{file.package}.{name}"] for name in _SCHEMA}


def parse(name: str, data: bytes) -> Any:  # noqa: ANN401
    """Returns a message of one type, or raises a ValueError."""
    error_class = require("google.protobuf.message", "protobuf").DecodeError
    try:
        return _messages()[name].FromString(data)
    except error_class as error:
        raise ValueError(f"a {name} message is damaged or cut short: {error}") from error


def open_segment(source: Path) -> SweepSource:
    """Opens a file like `segment-….tfrecord`."""
    if not source.is_file():
        raise DatasetError(f"{source}: no such file; expected the .tfrecord file of a segment")
    return SweepSource(FRAME_ID, None, _sweeps(source))


def _sweeps(path: Path) -> Iterator[LabelledSweep]:
    for index, record in enumerate(tf_records(path)):
        with reading(path, f"record {index}"):
            yield _sweep(parse("Frame", record))


def _sweep(frame: Any) -> LabelledSweep:  # noqa: ANN401
    calibrations = {one.name: _calibration(one) for one in frame.context.calibrations}
    returns = [
        LaserReturns(
            laser.name,
            _image(laser.first_return.image, 4),
            _image(laser.first_return.poses, 6) if laser.first_return.poses else None,
            calibrations[laser.name],
        )
        for laser in frame.lasers
        if laser.first_return.image
    ]
    boxes = tuple(_box(label) for label in frame.labels)
    pose = rigid_pose(list(frame.pose.values))
    # Segments of the test split have no labels in any frame.
    return waymo_sweep(frame.micros * 1000, pose, returns, boxes or None)


def _box(label: Any) -> Box:  # noqa: ANN401
    box = label.box
    center, size = (box.x, box.y, box.z), (box.length, box.width, box.height)
    return waymo_box(center, size, box.heading, label.type, label.id)


def _calibration(message: Any) -> LaserCalibration:  # noqa: ANN401
    mount = rigid_pose(list(message.mount.values))
    return LaserCalibration(mount, np.array(message.angles), (message.low, message.high))


def _image(compressed: bytes, channels: int) -> NDArray[np.float32]:
    """Returns the range image of a compressed message."""
    message = parse("Matrix", zlib.decompress(compressed))
    return shaped(message.data, message.shape.dims, channels)
