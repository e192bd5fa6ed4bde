# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Waymo Open (v2): the Parquet files of a segment, with range images of several lidars."""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import as_type, choose, files_in, reading
from mnsf_ros.datasets.surface_classes import UNKNOWN, WAYMO
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import FloatArray, apply, invert, planar_pose, rigid_pose
from mnsf_ros.sweeps_io.files import require

_STAMP: Final = "key.frame_timestamp_micros"
_LASER: Final = "key.laser_name"
_OBJECT: Final = "key.laser_object_id"
_IMAGE: Final = "[LiDARComponent].range_image_return1"
_POSES: Final = "[LiDARPoseComponent].range_image_return1"
_CALIBRATION: Final = "[LiDARCalibrationComponent]"
_VEHICLE: Final = "[VehiclePoseComponent].world_from_vehicle.transform"
_BOX: Final = "[LiDARBoxComponent]"


@dataclass(frozen=True, eq=False)
class LaserCalibration:
    """Mount and row angles of one lidar.

    Attributes:
        vehicle_from_laser: (4, 4) pose.
        inclinations_rad: (H,) angle above the horizontal of each row, from the lowest row up;
            empty if the rows are spread evenly over the range.
        range_rad: Lowest and highest angle.
    """

    vehicle_from_laser: NDArray[np.float64]
    inclinations_rad: NDArray[np.float64]
    range_rad: tuple[float, float]

    def row_inclinations(self, height: int) -> NDArray[np.float64]:
        """Returns (H,) angles in the order of the rows of an image: from the highest down."""
        angles = self.inclinations_rad
        if not len(angles):
            low, high = self.range_rad
            angles = low + (np.arange(height) + 0.5) / height * (high - low)
        if len(angles) != height:
            raise ValueError(f"range image of {height} rows for {len(angles)} inclinations")
        return angles[::-1]


@dataclass(frozen=True, eq=False)
class LaserReturns:
    """The range image of one lidar.

    Attributes:
        laser: Number of the lidar; 1 is on the roof.
        image: (H, W, 4) float32: range (m), intensity, elongation, 1 in a zone without labels.
        pixel_poses: (H, W, 6) float32: roll, pitch, yaw (rad), x, y, z (m) of the vehicle in
            the world at the time of each pixel; None: the same time for all.
        calibration: Calibration of the lidar.
    """

    laser: int
    image: NDArray[np.float32]
    pixel_poses: NDArray[np.float32] | None
    calibration: LaserCalibration

    def points(
        self, rows: NDArray[np.intp], columns: NDArray[np.intp], world_from_vehicle: FloatArray
    ) -> FloatArray:
        """Returns (N, 3) points of pixels in the vehicle frame of the sweep."""
        height, width = self.image.shape[:2]
        mount = self.calibration.vehicle_from_laser
        # The middle column looks to the front of the vehicle, not of the lidar.
        turn = math.atan2(mount[1, 0], mount[0, 0])
        azimuth = ((width - columns - 0.5) / width * 2 - 1) * math.pi - turn
        inclination = self.calibration.row_inclinations(height)[rows]
        distance = self.image[rows, columns, 0].astype(np.float64)
        level, up = distance * np.cos(inclination), distance * np.sin(inclination)
        local = np.stack([level * np.cos(azimuth), level * np.sin(azimuth), up], axis=1)
        points = apply(mount, local)
        if self.pixel_poses is None or not len(rows):
            return points
        pose = self.pixel_poses[rows, columns].astype(np.float64)
        points = Rotation.from_euler("ZYX", pose[:, 2::-1]).apply(points) + pose[:, 3:6]
        return apply(invert(world_from_vehicle), points)


def waymo_sweep(
    stamp_ns: int,
    world_from_vehicle: FloatArray,
    returns: Sequence[LaserReturns],
    boxes: tuple[Box, ...] | None,
) -> LabelledSweep:
    """Returns the first returns of all lidars as one sweep in the vehicle frame.

    Raises:
        ValueError: An image does not fit its calibration, or the sweep is refused.
        FloatingPointError: A point is too far away for a float32.
    """
    points: list[FloatArray] = [np.zeros((0, 3))]
    values: list[FloatArray] = [np.zeros((0, 4), dtype=np.float32)]
    numbers = [np.zeros(0)]
    for laser in sorted(returns, key=lambda one: one.laser):
        rows, columns = np.nonzero(laser.image[:, :, 0] > 0)
        points.append(laser.points(rows, columns, world_from_vehicle))
        values.append(laser.image[rows, columns, :4])
        numbers.append(np.full(len(rows), laser.laser))
    _, intensity, elongation, unlabelled = np.concatenate(values).T
    return LabelledSweep(
        stamp_ns=stamp_ns,
        xyz=as_type(np.concatenate(points), np.float32),
        columns={
            "intensity": np.ascontiguousarray(intensity),
            "elongation": np.ascontiguousarray(elongation),
            "laser": np.concatenate(numbers).astype(np.uint8),
        },
        pose=world_from_vehicle,
        boxes=boxes,
        labelled=unlabelled <= 0,
    )


def open_segment(source: Path, sequence: str | None = None) -> SweepSource:
    """Opens a segment, whose name is needed if there are several.

    The folder of a split has `lidar`, `lidar_pose`, `lidar_calibration`, `vehicle_pose` and mostly
    `lidar_box` in it.
    """
    names = [file.stem for file in files_in(source / "lidar", "*.parquet")]
    file_name = f"{choose(sequence, names, source / 'lidar', 'segment')}.parquet"
    path = source / "vehicle_pose" / file_name
    vehicle_poses = {}
    for micros, transform in _rows(path, [_STAMP, _VEHICLE]):
        with reading(path, f"frame {micros}"):
            vehicle_poses[micros] = rigid_pose(transform)
    return SweepSource("vehicle", len(vehicle_poses), _sweeps(source, file_name, vehicle_poses))


def _sweeps(
    source: Path, file_name: str, vehicle_poses: Mapping[int, NDArray[np.float64]]
) -> Iterator[LabelledSweep]:
    calibrations = _read_calibrations(source / "lidar_calibration" / file_name)
    box_file = source / "lidar_box" / file_name
    # A split without labels has none.
    boxes = _read_boxes(box_file) if box_file.is_file() else {}
    image_file, pose_file = source / "lidar" / file_name, source / "lidar_pose" / file_name
    pixel_poses = _frames(pose_file, _POSES, 6)
    for micros, images in _frames(image_file, _IMAGE, 4):
        pose_micros, poses = next(pixel_poses, (None, {}))
        if micros != pose_micros or micros not in vehicle_poses:
            raise DatasetError(f"{image_file}: frame {micros} has no pose in {pose_file.parent}")
        with reading(image_file):
            returns = [
                LaserReturns(laser, image, poses.get(laser), calibrations[laser])
                for laser, image in images.items()
            ]
            yield waymo_sweep(micros * 1000, vehicle_poses[micros], returns, boxes.get(micros))


def _frames(
    path: Path, prefix: str, channels: int
) -> Iterator[tuple[int, dict[int, NDArray[np.float32]]]]:
    """Yields the images of each frame by the number of their lidar."""
    rows = _rows(path, [_STAMP, _LASER, f"{prefix}.values", f"{prefix}.shape"], batch_size=1)
    last = -math.inf
    with reading(path):
        for micros, frame in groupby(rows, key=lambda row: int(row[0])):
            if micros < last:
                raise ValueError(f"its rows are not in the order of {_STAMP!r}")
            last = micros
            images = {
                laser: _image(values, shape, channels)
                for _, laser, values, shape in frame
                if values is not None
            }
            yield micros, images


def _image(values: ArrayLike, shape: Sequence[int], channels: int) -> NDArray[np.float32]:
    """Flat values as an image (H, W, `channels` or more)."""
    if len(shape) != 3 or shape[2] < channels:
        raise ValueError(f"range image of shape {list(shape)}, expected (H, W, {channels})")
    return np.asarray(values, dtype=np.float32).reshape(tuple(shape))


def _rows(path: Path, columns: Sequence[str], batch_size: int = 1000) -> Iterator[list[Any]]:
    """Yields the rows of a Parquet file, a batch in memory at a time, lists in them as arrays."""
    with reading(path), require("pyarrow.parquet").ParquetFile(path) as file:
        found = file.schema_arrow.names
        missing = [name for name in columns if name not in found]
        if missing:
            raise ValueError(f"has no column {', '.join(missing)}; it has {', '.join(found)}")
        # Where memory ends, the threads of Arrow abort the process.
        for batch in file.iter_batches(batch_size, columns=list(columns), use_threads=False):
            for number in range(batch.num_rows):
                yield [_value(batch.column(name)[number]) for name in columns]


def _value(scalar: Any) -> Any:  # noqa: ANN401
    values = getattr(scalar, "values", None)
    # Null lists have no values; numbers have no such attribute.
    return scalar.as_py() if values is None else np.asarray(values)


def _read_calibrations(path: Path) -> dict[int, LaserCalibration]:
    angles = [f"{_CALIBRATION}.beam_inclination.{name}" for name in ("values", "min", "max")]
    columns = [_LASER, f"{_CALIBRATION}.extrinsic.transform", *angles]
    with reading(path):
        return {
            laser: LaserCalibration(
                rigid_pose(transform),
                np.zeros(0) if values is None else np.asarray(values, dtype=np.float64),
                (low, high),
            )
            for laser, transform, values, low, high in _rows(path, columns)
        }


def _read_boxes(path: Path) -> Mapping[int, tuple[Box, ...]]:
    places = [f"{_BOX}.box.{part}.{axis}" for part in ("center", "size") for axis in "xyz"]
    columns = [_STAMP, _OBJECT, f"{_BOX}.box.heading", f"{_BOX}.type", *places]
    boxes: dict[int, tuple[Box, ...]] = defaultdict(tuple)
    for micros, track_id, heading, kind, x, y, z, *size in _rows(path, columns):
        with reading(path, f"frame {micros}"):
            pose, size_m = planar_pose(x, y, heading, z), np.array(size, dtype=np.float64)
            boxes[micros] += (Box(pose, size_m, WAYMO.get(kind, UNKNOWN), track_id),)
    return boxes
