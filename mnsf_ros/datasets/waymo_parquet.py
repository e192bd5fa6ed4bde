"""Waymo Open, second edition: a Parquet file for each segment and component."""

from __future__ import annotations

from collections import defaultdict
from typing import TYPE_CHECKING, Any, Final

import numpy as np

from mnsf_ros.datasets.arrow_tables import parquet_groups, read_parquet
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import files_in, reading
from mnsf_ros.datasets.surface_classes import waymo_class
from mnsf_ros.datasets.waymo_range_image import (
    FRAME_ID,
    LaserCalibration,
    LaserReturns,
    shaped,
    waymo_sweep,
)
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import planar_pose, rigid_pose

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.formats import ReadOptions

_STAMP: Final = "key.frame_timestamp_micros"
_LASER: Final = "key.laser_name"
_OBJECT: Final = "key.laser_object_id"
_IMAGE: Final = "[LiDARComponent].range_image_return1"
_POSES: Final = "[LiDARPoseComponent].range_image_return1"
_CALIBRATION: Final = "[LiDARCalibrationComponent]"
_VEHICLE: Final = "[VehiclePoseComponent].world_from_vehicle.transform"
_BOX: Final = "[LiDARBoxComponent]"


def open_sequence(source: Path, options: ReadOptions) -> SweepSource:
    """Opens a segment.

    Args:
        source: The folder of a split, with `lidar`, `lidar_pose`, `lidar_calibration`,
            `vehicle_pose` and mostly `lidar_box` in it.
        options: `sequence`: name of the segment, needed if there are several.

    Raises:
        DatasetError: If something that is needed is missing or damaged.
    """
    file_name = f"{_segment(source, options.sequence)}.parquet"
    vehicle_poses = _read_vehicle_poses(source / "vehicle_pose" / file_name)
    sweeps = _sweeps(source, file_name, vehicle_poses)
    return SweepSource(FRAME_ID, len(vehicle_poses), sweeps)


def _segment(source: Path, name: str | None) -> str:
    names = [file.stem for file in files_in(source / "lidar", "*.parquet")]
    if name is None and len(names) == 1:
        return names[0]
    if name in names:
        return str(name)
    found = f"{', '.join(names[:3])}{', …' if len(names) > 3 else ''}"
    wanted = "several segments, name one" if name is None else f"no segment {name!r}"
    raise DatasetError(f"{source / 'lidar'}: holds {wanted}; it has {found}")


def _sweeps(
    source: Path, file_name: str, vehicle_poses: Mapping[int, NDArray[np.float64]]
) -> Iterator[LabelledSweep]:
    calibrations = _read_calibrations(source / "lidar_calibration" / file_name)
    box_file = source / "lidar_box" / file_name
    boxes = _read_boxes(box_file) if box_file.is_file() else {}
    image_file, pose_file = source / "lidar" / file_name, source / "lidar_pose" / file_name
    images = parquet_groups(image_file, _STAMP, _image_columns(_IMAGE))
    pixel_poses = parquet_groups(pose_file, _STAMP, _image_columns(_POSES))
    for micros, rows in images:
        pose_micros, pose_rows = next(pixel_poses, (None, []))
        if micros != pose_micros or micros not in vehicle_poses:
            raise DatasetError(f"{image_file}: frame {micros} has no pose in {pose_file.parent}")
        with reading(image_file):
            returns = _returns(rows, pose_rows, calibrations)
            sweep = waymo_sweep(micros * 1000, vehicle_poses[micros], returns, boxes.get(micros))
        yield sweep


def _image_columns(prefix: str) -> list[str]:
    return [_LASER, f"{prefix}.values", f"{prefix}.shape"]


def _returns(
    rows: list[dict[str, Any]],
    pose_rows: list[dict[str, Any]],
    calibrations: Mapping[int, LaserCalibration],
) -> list[LaserReturns]:
    poses = {row[_LASER]: _image(row, _POSES, 6) for row in pose_rows}
    return [
        LaserReturns(
            row[_LASER], _image(row, _IMAGE, 4), poses.get(row[_LASER]), calibrations[row[_LASER]]
        )
        for row in rows
        if row[f"{_IMAGE}.values"] is not None
    ]


def _image(row: dict[str, Any], prefix: str, channels: int) -> NDArray[np.float32]:
    return shaped(row[f"{prefix}.values"], row[f"{prefix}.shape"], channels)


def _read_vehicle_poses(path: Path) -> dict[int, NDArray[np.float64]]:
    poses = {}
    for row in read_parquet(path, [_STAMP, _VEHICLE]):
        with reading(path, f"frame {row[_STAMP]}"):
            poses[row[_STAMP]] = rigid_pose(row[_VEHICLE])
    return poses


def _read_calibrations(path: Path) -> dict[int, LaserCalibration]:
    extrinsic = f"{_CALIBRATION}.extrinsic.transform"
    low, high, values = (f"{_CALIBRATION}.beam_inclination.{n}" for n in ("min", "max", "values"))
    rows = read_parquet(path, [_LASER, extrinsic, low, high, values])
    with reading(path):
        return {
            row[_LASER]: LaserCalibration(
                vehicle_from_laser=rigid_pose(row[extrinsic]),
                inclinations_rad=np.array(row[values] or [], dtype=np.float64),
                range_rad=(row[low], row[high]),
            )
            for row in rows
        }


def _read_boxes(path: Path) -> dict[int, tuple[Box, ...]]:
    center = [f"{_BOX}.box.center.{axis}" for axis in "xyz"]
    size = [f"{_BOX}.box.size.{axis}" for axis in "xyz"]
    heading, kind = f"{_BOX}.box.heading", f"{_BOX}.type"
    boxes: dict[int, list[Box]] = defaultdict(list)
    for row in read_parquet(path, [_STAMP, _OBJECT, *center, *size, heading, kind]):
        with reading(path, f"frame {row[_STAMP]}"):
            x, y, z = (row[name] for name in center)
            box = Box(
                pose=planar_pose(x, y, row[heading], z),
                size_m=np.array([row[name] for name in size], dtype=np.float64),
                class_id=waymo_class(row[kind]),
                track_id=row[_OBJECT],
            )
        boxes[row[_STAMP]].append(box)
    return {micros: tuple(found) for micros, found in boxes.items()}
