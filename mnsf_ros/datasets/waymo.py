# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Waymo Open (v2): the Parquet files of a segment, with range images of several lidars."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import apply, invert, planar_pose, rigid_pose
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.sweeps_io.files import as_type, check_columns, choose, files_in, reading

_STAMP: Final = "key.frame_timestamp_micros"
_LASER: Final = "key.laser_name"
_OBJECT: Final = "key.laser_object_id"
_IMAGE: Final = "[LiDARComponent].range_image_return1"
_POSES: Final = "[LiDARPoseComponent].range_image_return1"
_CALIBRATION: Final = "[LiDARCalibrationComponent]"
_VEHICLE: Final = "[VehiclePoseComponent].world_from_vehicle.transform"
_BOX: Final = "[LiDARBoxComponent]"
WAYMO: Final = {
    1: int(SurfaceClass.CAR),
    2: int(SurfaceClass.PEDESTRIAN),
    3: int(SurfaceClass.OBSTACLE),
    4: int(SurfaceClass.CYCLIST),
}


class _Laser(NamedTuple):
    """Mount and row angles of one lidar."""

    vehicle_from_laser: Floats
    # (H,) above the horizontal, from the lowest row up; None: spread evenly over the range.
    inclinations_rad: Floats | None
    range_rad: tuple[float, float]  # lowest and highest angle

    def points(self, image: Floats32) -> Floats:
        """Returns (H, W, 3) points of the pixels of a range image (H, W, ...), vehicle frame."""
        height, width = image.shape[:2]
        angles, (low, high) = self.inclinations_rad, self.range_rad
        if angles is None:
            angles = low + (np.arange(height) + 0.5) / height * (high - low)
        if len(angles) != height:
            raise ValueError(f"range image of {height} rows for {len(angles)} inclinations")
        # Rows go from the highest down. The middle column looks to the front of the vehicle, not of
        # the lidar.
        turn = math.atan2(self.vehicle_from_laser[1, 0], self.vehicle_from_laser[0, 0])
        azimuth = (1 - (np.arange(width) + 0.5) / width * 2) * math.pi - turn
        up, around = angles[::-1, None], azimuth[None]
        rays = (np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), np.sin(up + 0 * around))
        distance = image[..., 0].astype(np.float64)
        return np.asarray(apply(self.vehicle_from_laser, np.stack(rays, -1) * distance[..., None]))


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
    source: Path, file_name: str, vehicle_poses: Mapping[int, Floats]
) -> Iterator[LabelledSweep]:
    lasers = _read_calibrations(source / "lidar_calibration" / file_name)
    box_file = source / "lidar_box" / file_name
    # A split without labels has none.
    boxes = _read_boxes(box_file) if box_file.is_file() else {}
    image_file, pose_file = source / "lidar" / file_name, source / "lidar_pose" / file_name
    pixel_poses = _frames(pose_file, _POSES)
    for micros, images in _frames(image_file, _IMAGE):
        pose_micros, poses = next(pixel_poses, (None, {}))
        if micros != pose_micros or micros not in vehicle_poses:
            raise DatasetError(f"{image_file}: frame {micros} has no pose in {pose_file.parent}")
        pose = vehicle_poses[micros]
        with reading(image_file):
            # x, y, z, intensity, elongation, in a zone without labels, number of the lidar.
            rows = np.concatenate(
                [np.zeros((0, 7))]
                + [
                    _returns(number, images[number], poses.get(number), lasers[number], pose)
                    for number in sorted(images)
                ]
            )
            yield LabelledSweep(
                stamp_ns=micros * 1000,
                xyz=as_type(rows[:, :3], np.float32),
                columns={
                    "intensity": rows[:, 3].astype(np.float32),
                    "elongation": rows[:, 4].astype(np.float32),
                    "laser": rows[:, 6].astype(np.uint8),
                },
                pose=pose,
                boxes=boxes.get(micros),
                labelled=rows[:, 5] <= 0,
            )


def _returns(
    number: int,
    image: Floats32,
    pixel_poses: Floats32 | None,
    laser: _Laser,
    world_from_vehicle: Floats,
) -> Floats:
    """Returns the first returns of one lidar, (N, 7), in the vehicle frame of the sweep.

    The channels of its image (H, W, 4) are range (m), intensity, elongation, and 1 in a zone
    without labels. `pixel_poses` (H, W, 6) are roll, pitch, yaw (rad), x, y, z (m) of the vehicle
    in the world at the time of each pixel; None: the same time for all.
    """
    hit = image[..., 0] > 0
    points = laser.points(image)[hit]
    if pixel_poses is not None and len(points):
        poses = pixel_poses[hit].astype(np.float64)
        world = Rotation.from_euler("ZYX", poses[:, 2::-1]).apply(points) + poses[:, 3:6]
        points = np.asarray(apply(invert(world_from_vehicle), world), dtype=np.float64)
    return np.column_stack([points, image[hit][:, 1:4], np.full(len(points), number)])


def _frames(path: Path, prefix: str) -> Iterator[tuple[int, dict[int, Floats32]]]:
    """Yields the images of each frame by the number of their lidar."""
    rows = _rows(path, [_STAMP, _LASER, f"{prefix}.values", f"{prefix}.shape"], batch_size=1)
    with reading(path):
        for micros, frame in groupby(rows, key=lambda row: int(row[0])):
            images = {
                laser: np.asarray(values, dtype=np.float32).reshape(tuple(shape))
                for _, laser, values, shape in frame
                if values is not None
            }
            yield micros, images


def _rows(path: Path, columns: Sequence[str], batch_size: int = 1000) -> Iterator[list[Any]]:
    """Yields the rows of a Parquet file, a batch in memory at a time, lists in them as arrays."""
    from pyarrow import parquet

    with reading(path), parquet.ParquetFile(path) as file:
        check_columns(file.schema_arrow.names, columns)
        # Where memory ends, the threads of Arrow abort the process.
        for batch in file.iter_batches(batch_size, columns=list(columns), use_threads=False):
            for number in range(batch.num_rows):
                yield [_value(batch.column(name)[number]) for name in columns]


def _value(scalar: Any) -> Any:  # noqa: ANN401
    values = getattr(scalar, "values", None)
    # Null lists have no values; numbers have no such attribute.
    return scalar.as_py() if values is None else np.asarray(values)


def _read_calibrations(path: Path) -> dict[int, _Laser]:
    angles = [f"{_CALIBRATION}.beam_inclination.{name}" for name in ("values", "min", "max")]
    columns = [_LASER, f"{_CALIBRATION}.extrinsic.transform", *angles]
    with reading(path):
        return {
            laser: _Laser(rigid_pose(transform), values, (low, high))
            for laser, transform, values, low, high in _rows(path, columns)
        }


def _read_boxes(path: Path) -> Mapping[int, tuple[Box, ...]]:
    places = [f"{_BOX}.box.{part}.{axis}" for part in ("center", "size") for axis in "xyz"]
    columns = [_STAMP, _OBJECT, f"{_BOX}.box.heading", f"{_BOX}.type", *places]
    boxes: dict[int, tuple[Box, ...]] = defaultdict(tuple)
    for micros, track_id, heading, kind, x, y, z, *size in _rows(path, columns):
        with reading(path, f"frame {micros}"):
            pose, size_m = planar_pose(x, y, heading, z), np.array(size, dtype=np.float64)
            boxes[micros] += (Box(pose, size_m, WAYMO.get(kind, 0), track_id),)
    return boxes
