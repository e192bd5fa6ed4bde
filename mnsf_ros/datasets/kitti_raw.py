"""KITTI raw: a drive with synchronized sweeps, GPS/IMU and tracklets."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING, Final

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.kitti_calibration import CameraView, read_camera_view, read_rigid
from mnsf_ros.datasets.kitti_tracklets import read_tracklets
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import files_in, read_float_rows, reading, stamp_in
from mnsf_ros.geometry.transforms import invert, planar_pose, tilt

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.read_options import ReadOptions

_EARTH_RADIUS_M: Final = 6_378_137.0
_IMU_CALIBRATION: Final = "calib_imu_to_velo.txt"


def open_sequence(source: Path, _: ReadOptions) -> SweepSource:
    """Opens a drive.

    Args:
        source: A folder like `2011_09_26/2011_09_26_drive_0005_sync`, with the calibration in
            it or in the folder above.

    Raises:
        DatasetError: If something that is needed is missing or damaged.
    """
    files = files_in(source / "velodyne_points" / "data", "*.bin")
    drive = _Drive(source, stamp_in(files[0].stem, files[0]))
    return SweepSource("velodyne", len(files), (drive.sweep(file) for file in files))


class _Drive:
    """The parts of a drive that do not belong to one sweep."""

    def __init__(self, source: Path, first: int) -> None:
        above = source.resolve().parent
        calibration = source if (source / _IMU_CALIBRATION).is_file() else above
        self._source = source
        self._imu_from_lidar = invert(read_rigid(calibration / _IMU_CALIBRATION))
        self._stamps_file = source / "velodyne_points" / "timestamps.txt"
        with reading(self._stamps_file):
            self._stamps = self._stamps_file.read_text(encoding="ascii").splitlines()
        self._boxes: Mapping[int, tuple[Box, ...]] | None = None
        self._view: CameraView | None = None
        tracklets = source / "tracklet_labels.xml"
        if tracklets.is_file():
            self._boxes = read_tracklets(tracklets)
            self._view = read_camera_view(calibration)
        self._origin = self._imu_reading(first)[:3]

    def sweep(self, file: Path) -> LabelledSweep:
        number = stamp_in(file.stem, file)
        rows = read_float_rows(file, 4)
        xyz = np.ascontiguousarray(rows[:, :3])
        with reading(file):
            return LabelledSweep(
                stamp_ns=self._stamp_ns(number),
                xyz=xyz,
                columns={"intensity": rows[:, 3]},
                pose=self._world_from_imu(number) @ self._imu_from_lidar,
                boxes=None if self._boxes is None else self._boxes.get(number, ()),
                labelled=None if self._view is None else self._view.sees(xyz),
            )

    def _stamp_ns(self, number: int) -> int:
        # The line of a sweep that was lost is empty, and its file is not there.
        line = self._stamps[number].strip() if number < len(self._stamps) else ""
        if not line:
            raise DatasetError(f"{self._stamps_file}: has no line {number + 1} for that sweep")
        with reading(self._stamps_file):
            return int(np.datetime64(line.replace(" ", "T"), "ns").astype(np.int64))

    def _world_from_imu(self, number: int) -> NDArray[np.float64]:
        latitude, longitude, altitude, roll, pitch, yaw = self._imu_reading(number)
        latitude_0, longitude_0, altitude_0 = self._origin
        # Mercator, true to scale at the first sweep.
        scale = _EARTH_RADIUS_M * math.cos(math.radians(latitude_0))
        north = _mercator(latitude) - _mercator(latitude_0)
        pose = planar_pose(
            scale * math.radians(longitude - longitude_0),
            scale * north,
            yaw,
            altitude - altitude_0,
        )
        world_from_imu: NDArray[np.float64] = pose @ tilt(pitch, roll)
        return world_from_imu

    def _imu_reading(self, number: int) -> tuple[float, ...]:
        """Latitude and longitude (degrees), altitude (m), roll, pitch and yaw (rad)."""
        path = self._source / "oxts" / "data" / f"{number:010d}.txt"
        with reading(path):
            values = tuple(float(word) for word in path.read_text(encoding="ascii").split()[:6])
        if len(values) < 6:
            raise DatasetError(f"{path}: has {len(values)} numbers, expected 30")
        if not np.isfinite(values).all():
            raise DatasetError(f"{path}: holds {values}, expected finite numbers")
        return values


def _mercator(latitude_deg: float) -> float:
    return math.log(math.tan(math.pi / 4 + math.radians(latitude_deg) / 2))
