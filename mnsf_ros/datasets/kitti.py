# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""KITTI raw: a drive with synchronized sweeps, calibration, GPS/IMU and tracklets."""

from __future__ import annotations

import math
from collections import defaultdict
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import (
    numbered_files,
    read_content,
    read_float_rows,
    read_lines,
    reading,
)
from mnsf_ros.datasets.surface_classes import KITTI, UNKNOWN
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import apply, invert, planar_pose, rigid_pose, tilt

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

_EARTH_RADIUS_M: Final = 6_378_137.0
_IMU_CALIBRATION: Final = "calib_imu_to_velo.txt"


def open_drive(source: Path) -> SweepSource:
    """Opens a folder like `2011_09_26/2011_09_26_drive_0005_sync`.

    The calibration is in it or in the folder above.
    """
    files = numbered_files(source / "velodyne_points" / "data", "*.bin")
    drive = _Drive(source, first=next(iter(files)))
    sweeps = (drive.sweep(number, file) for number, file in files.items())
    return SweepSource("velodyne", len(files), sweeps)


class _Drive:
    """The parts of a drive that do not belong to one sweep."""

    def __init__(self, source: Path, first: int) -> None:
        here = (source / _IMU_CALIBRATION).is_file()
        calibration = source if here else source.resolve().parent
        self._source = source
        self._imu_from_lidar = invert(_Calibration(calibration / _IMU_CALIBRATION).rigid())
        self._stamps_file = source / "velodyne_points" / "timestamps.txt"
        self._stamps = read_lines(self._stamps_file)
        tracklets = source / "tracklet_labels.xml"
        is_labelled = tracklets.is_file()
        self._boxes = _read_tracklets(tracklets) if is_labelled else None
        self._camera = _Camera(calibration) if is_labelled else None
        self._origin = self._imu_reading(first)[:3]

    def sweep(self, number: int, file: Path) -> LabelledSweep:
        rows = read_float_rows(file, 4)
        xyz = np.ascontiguousarray(rows[:, :3])
        with reading(file):
            return LabelledSweep(
                stamp_ns=self._stamp_ns(number),
                xyz=xyz,
                columns={"intensity": rows[:, 3]},
                pose=self._world_from_imu(number) @ self._imu_from_lidar,
                boxes=None if self._boxes is None else self._boxes.get(number, ()),
                labelled=None if self._camera is None else self._camera.sees(xyz),
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
        east = scale * math.radians(longitude - longitude_0)
        north = scale * (_mercator(latitude) - _mercator(latitude_0))
        pose = planar_pose(east, north, yaw, altitude - altitude_0)
        world_from_imu: NDArray[np.float64] = pose @ tilt(pitch, roll)
        return world_from_imu

    def _imu_reading(self, number: int) -> tuple[float, ...]:
        """Latitude and longitude (degrees), altitude (m), roll, pitch and yaw (rad)."""
        path = self._source / "oxts" / "data" / f"{number:010d}.txt"
        words = " ".join(read_lines(path)).split()[:6]
        with reading(path):
            values = tuple(float(word) for word in words)
        if len(values) < 6:
            raise DatasetError(f"{path}: has {len(values)} numbers, expected 30")
        if not np.isfinite(values).all():
            raise DatasetError(f"{path}: holds {values}, expected finite numbers")
        return values


def _mercator(latitude_deg: float) -> float:
    return math.log(math.tan(math.pi / 4 + math.radians(latitude_deg) / 2))


class _Calibration:
    """A file with a name and numbers on each line."""

    def __init__(self, path: Path) -> None:
        pairs = (line.partition(":") for line in read_lines(path))
        self._path = path
        self._entries = {name.strip(): values for name, colon, values in pairs if colon}

    def numbers(self, name: str, *shape: int) -> NDArray[np.float64]:
        if name not in self._entries:
            found = ", ".join(self._entries)
            raise DatasetError(f"{self._path}: has no entry {name!r}; it has {found}")
        with reading(self._path):
            return np.array(self._entries[name].split(), dtype=np.float64).reshape(shape)

    def rigid(self) -> NDArray[np.float64]:
        """The (4, 4) transform of R and T."""
        transform = np.eye(4)
        transform[:3, :3] = self.numbers("R", 3, 3)
        transform[:3, 3] = self.numbers("T", 3)
        with reading(self._path):
            return rigid_pose(transform)


class _Camera:
    """The left colour camera, in whose image objects were labelled."""

    def __init__(self, folder: Path) -> None:
        camera = _Calibration(folder / "calib_cam_to_cam.txt")
        rectified = np.eye(4)
        rectified[:3, :3] = camera.numbers("R_rect_00", 3, 3)
        self._size = camera.numbers("S_rect_02", 2)
        camera_from_lidar = _Calibration(folder / "calib_velo_to_cam.txt").rigid()
        self._image_from_lidar = camera.numbers("P_rect_02", 3, 4) @ rectified @ camera_from_lidar

    def sees(self, xyz: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns (N,) whether points (N, 3) of the lidar are in the image."""
        with np.errstate(invalid="ignore"):
            u, v, depth = apply(self._image_from_lidar, xyz.astype(np.float64)).T
        width, height = self._size
        # Not divided by the depth, which may be zero.
        inside: NDArray[np.bool_] = (
            (depth > 0) & (u >= 0) & (u < width * depth) & (v >= 0) & (v < height * depth)
        )
        return inside


def _read_tracklets(path: Path) -> Mapping[int, tuple[Box, ...]]:
    """The boxes in the lidar frame by the number of their sweep."""
    boxes: dict[int, tuple[Box, ...]] = defaultdict(tuple)
    content = read_content(path)
    with reading(path):
        tracklets = ElementTree.fromstring(content).find("tracklets")
        if tracklets is None:
            raise ValueError("has no element 'tracklets'")
        for track_id, tracklet in enumerate(tracklets.findall("item")):
            for number, box in _boxes_of(path, tracklet, track_id):
                boxes[number] += (box,)
    return boxes


def _boxes_of(
    path: Path, tracklet: ElementTree.Element, track_id: int
) -> Iterator[tuple[int, Box]]:
    length, width, height = (_number(tracklet, name) for name in "lwh")
    size = np.array([length, width, height])
    class_id = KITTI.get(tracklet.findtext("objectType", ""), UNKNOWN)
    first = int(_number(tracklet, "first_frame"))
    for number, pose in enumerate(tracklet.findall("poses/item"), start=first):
        with reading(path, f"sweep {number}"):
            x, y, z, yaw = (_number(pose, name) for name in ("tx", "ty", "tz", "rz"))
            # A tracklet stands on its position, a Box has it in the middle.
            box = Box(planar_pose(x, y, yaw, z + height / 2), size, class_id, track_id)
        yield number, box


def _number(element: ElementTree.Element, name: str) -> float:
    text = element.findtext(name)
    if text is None:
        raise ValueError(f"a {element.tag!r} has no element {name!r}")
    return float(text)
