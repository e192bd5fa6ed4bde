"""Waymo Open, first edition: a TFRecord file of `Frame` messages for each segment."""

from __future__ import annotations

import struct
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.protobuf_wire import WireMessage
from mnsf_ros.datasets.source_files import reading
from mnsf_ros.datasets.surface_classes import waymo_class
from mnsf_ros.datasets.waymo_range_image import (
    FRAME_ID,
    LaserCalibration,
    LaserReturns,
    shaped,
    waymo_sweep,
)
from mnsf_ros.decompression import decompress
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import planar_pose, rigid_pose

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.formats import ReadOptions

_HEADER: Final = struct.Struct("<QI")
_FOOTER_BYTES: Final = 4
_CASTAGNOLI: Final = 0x82F63B78


def tf_records(path: Path) -> Iterator[bytes]:
    """Yields the records of an uncompressed file.

    The checksum of the length of a record is compared, which tells other files apart; that of
    its content is not, since without a library for it this takes longer than all the rest.

    Raises:
        DatasetError: If the file is missing, is none of these, is empty, or is cut short.
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
    """CRC-32C, rotated and shifted as TFRecord wants it."""
    crc = 0xFFFFFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = (crc >> 1) ^ (_CASTAGNOLI if crc & 1 else 0)
    crc ^= 0xFFFFFFFF
    return (((crc >> 15) | (crc << 17)) + 0xA282EAD8) & 0xFFFFFFFF


# Numbers of the fields that are read, by message.
_FRAME: Final = {"context": 1, "timestamp_micros": 2, "pose": 3, "lasers": 5, "labels": 6}
_CONTEXT: Final = {"laser_calibrations": 3}
_CALIBRATION: Final = {"name": 1, "inclinations": 2, "min": 3, "max": 4, "extrinsic": 5}
_LASER: Final = {"name": 1, "first_return": 2}
_RANGE_IMAGE: Final = {"range_image": 2, "pose": 4}
_MATRIX: Final = {"data": 1, "shape": 2}
_LABEL: Final = {"box": 1, "type": 3, "id": 4}
_BOX: Final = {"x": 1, "y": 2, "z": 3, "width": 4, "length": 5, "height": 6, "heading": 7}
# The only field of MatrixShape and of Transform.
_ONLY: Final = 1


def open_sequence(source: Path, _: ReadOptions) -> SweepSource:
    """Opens a segment.

    Args:
        source: A file like `segment-….tfrecord`.

    Raises:
        DatasetError: If there is no such file.
    """
    if not source.is_file():
        raise DatasetError(f"{source}: no such file; expected the .tfrecord file of a segment")
    return SweepSource(FRAME_ID, None, _sweeps(source))


def _sweeps(path: Path) -> Iterator[LabelledSweep]:
    for index, record in enumerate(tf_records(path)):
        with reading(path, f"record {index}"):
            sweep = _sweep(WireMessage(record))
        yield sweep


def _sweep(frame: WireMessage) -> LabelledSweep:
    context = frame.message(_FRAME["context"])
    calibrations = dict(map(_calibration, context.messages(_CONTEXT["laser_calibrations"])))
    returns = [_returns(laser, calibrations) for laser in frame.messages(_FRAME["lasers"])]
    labels = frame.messages(_FRAME["labels"])
    return waymo_sweep(
        stamp_ns=frame.integer(_FRAME["timestamp_micros"]) * 1000,
        world_from_vehicle=_transform(frame.message(_FRAME["pose"])),
        returns=[laser for laser in returns if laser is not None],
        # Segments of the test split have no labels in any frame.
        boxes=tuple(_box(label) for label in labels) or None,
    )


def _calibration(message: WireMessage) -> tuple[int, LaserCalibration]:
    low, high = (message.double(_CALIBRATION[name]) for name in ("min", "max"))
    calibration = LaserCalibration(
        vehicle_from_laser=_transform(message.message(_CALIBRATION["extrinsic"])),
        inclinations_rad=message.doubles(_CALIBRATION["inclinations"]),
        range_rad=(low, high),
    )
    return message.integer(_CALIBRATION["name"]), calibration


def _returns(
    message: WireMessage, calibrations: Mapping[int, LaserCalibration]
) -> LaserReturns | None:
    name = message.integer(_LASER["name"])
    first = message.message(_LASER["first_return"])
    image = _matrix(first.data(_RANGE_IMAGE["range_image"]), 4)
    if image is None:
        return None
    poses = _matrix(first.data(_RANGE_IMAGE["pose"]), 6)
    return LaserReturns(name, image, poses, calibrations[name])


def _matrix(compressed: bytes, channels: int) -> NDArray[np.float32] | None:
    if not compressed:
        return None
    matrix = WireMessage(decompress("zlib", compressed))
    shape = matrix.message(_MATRIX["shape"]).integers(_ONLY)
    return shaped(matrix.floats(_MATRIX["data"]), shape, channels)


def _transform(message: WireMessage) -> NDArray[np.float64]:
    return rigid_pose(message.doubles(_ONLY))


def _box(label: WireMessage) -> Box:
    box = label.message(_LABEL["box"])
    numbers: dict[str, Any] = {name: box.double(number) for name, number in _BOX.items()}
    return Box(
        pose=planar_pose(numbers["x"], numbers["y"], numbers["heading"], numbers["z"]),
        size_m=np.array([numbers["length"], numbers["width"], numbers["height"]]),
        class_id=waymo_class(label.integer(_LABEL["type"])),
        track_id=label.text(_LABEL["id"]),
    )
