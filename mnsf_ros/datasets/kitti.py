# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""KITTI raw: a drive with synchronized sweeps, calibration, GPS/IMU and tracklets."""

import math
from collections import defaultdict
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final
from xml.etree import ElementTree

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Floats32
from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource, classes_of
from mnsf_ros.geometry.transforms import apply, invert, planar_pose, rigid_pose, tilt
from mnsf_ros.sweeps_io.files import numbered_files, read_float_rows, read_lines, reading

_EARTH_RADIUS_M: Final = 6_378_137.0
_IMU_CALIBRATION: Final = "calib_imu_to_velo.txt"
KITTI: Final = classes_of(
    car="Car, Van",
    pedestrian="Pedestrian, Person (sitting)",
    cyclist="Cyclist",
    large_vehicle="Truck, Tram",
)


def open_drive(source: Path) -> SweepSource:
    """Opens a folder like `2011_09_26/2011_09_26_drive_0005_sync`.

    The calibration is in it or in the folder above.
    """
    files = numbered_files(source / "velodyne_points" / "data", "*.bin")
    here = (source / _IMU_CALIBRATION).is_file()
    calibration = source if here else source.resolve().parent
    imu_from_lidar = invert(_rigid_transform(calibration / _IMU_CALIBRATION))
    stamps_file = source / "velodyne_points" / "timestamps.txt"
    stamps = read_lines(stamps_file)
    tracklets = source / "tracklet_labels.xml"
    boxes = _read_tracklets(tracklets) if tracklets.is_file() else None
    camera = None if boxes is None else _Camera(calibration)
    origin = _imu_reading(source, next(iter(files)))[:3]

    def sweeps() -> Iterator[LabelledSweep]:
        for number, file in files.items():
            # The line of a lost sweep is empty, and its file is missing.
            with reading(stamps_file, f"line {number + 1}"):
                stamp = np.datetime64(stamps[number].replace(" ", "T"), "ns")
            rows = read_float_rows(file, 4)
            xyz = np.ascontiguousarray(rows[:, :3])
            with reading(file):
                yield LabelledSweep(
                    stamp_ns=int(stamp.astype(np.int64)),
                    xyz=xyz,
                    columns={"intensity": rows[:, 3]},
                    pose=_world_from_imu(_imu_reading(source, number), origin) @ imu_from_lidar,
                    boxes=None if boxes is None else boxes.get(number, ()),
                    labelled=None if camera is None else camera.sees(xyz),
                )

    return SweepSource("velodyne", len(files), sweeps())


def _world_from_imu(imu: Floats, origin: Floats) -> Floats:
    latitude, longitude, altitude, roll, pitch, yaw = imu.tolist()
    latitude_0, longitude_0, altitude_0 = origin.tolist()
    # Mercator, true to scale at the first sweep.
    scale = _EARTH_RADIUS_M * math.cos(math.radians(latitude_0))
    east = scale * math.radians(longitude - longitude_0)
    north = scale * (_mercator(latitude) - _mercator(latitude_0))
    pose = planar_pose(east, north, yaw, altitude - altitude_0)
    return pose @ tilt(pitch, roll)


def _imu_reading(source: Path, number: int) -> Floats:
    """(6,) latitude and longitude (degrees), altitude (m), roll, pitch and yaw (rad)."""
    path = source / "oxts" / "data" / f"{number:010d}.txt"
    words = " ".join(read_lines(path)).split()[:6]
    with reading(path):
        values = np.array(words, dtype=np.float64)
        if len(values) < 6 or not np.isfinite(values).all():
            raise ValueError(f"begins with {values.tolist()}, expected 6 finite numbers")
        return values


def _mercator(latitude_deg: float) -> float:
    return math.log(math.tan(math.pi / 4 + math.radians(latitude_deg) / 2))


def _calibration(path: Path, **shapes: tuple[int, ...]) -> list[Floats]:
    """Returns entries of a file with a name and numbers on each line, by name and shape."""
    entries = dict(line.split(":", 1) for line in read_lines(path) if ":" in line)
    with reading(path):
        return [
            np.array(entries[name].split(), dtype=np.float64).reshape(shape)
            for name, shape in shapes.items()
        ]


def _rigid_transform(path: Path) -> Floats:
    transform = np.eye(4)
    transform[:3, :3], transform[:3, 3] = _calibration(path, R=(3, 3), T=(3,))
    with reading(path):
        return rigid_pose(transform)


class _Camera:
    """The left colour camera: objects were labelled in its image."""

    def __init__(self, folder: Path) -> None:
        rectified = np.eye(4)
        rectified[:3, :3], self._size, projection = _calibration(
            folder / "calib_cam_to_cam.txt", R_rect_00=(3, 3), S_rect_02=(2,), P_rect_02=(3, 4)
        )
        camera_from_lidar = _rigid_transform(folder / "calib_velo_to_cam.txt")
        self._image_from_lidar = projection @ rectified @ camera_from_lidar

    def sees(self, xyz: Floats32) -> Bools:
        """Returns (N,) whether points (N, 3) of the lidar are in the image."""
        with np.errstate(invalid="ignore"):
            u, v, depth = apply(self._image_from_lidar, xyz.astype(np.float64)).T
        width, height = self._size
        # Not divided by the depth, which may be zero.
        return (depth > 0) & (u >= 0) & (u < width * depth) & (v >= 0) & (v < height * depth)


def _read_tracklets(path: Path) -> Mapping[int, tuple[Box, ...]]:
    """Returns the boxes in the lidar frame by the number of their sweep."""
    boxes: dict[int, tuple[Box, ...]] = defaultdict(tuple)
    with reading(path):
        tracklets = ElementTree.parse(path).find("tracklets")
        if tracklets is None:
            raise ValueError("has no element 'tracklets'")
        for track_id, tracklet in enumerate(tracklets.findall("item")):
            for number, box in _boxes_of(path, tracklet, track_id):
                boxes[number] += (box,)
    return boxes


def _boxes_of(
    path: Path, tracklet: ElementTree.Element, track_id: int
) -> Iterator[tuple[int, Box]]:
    length, width, height = _numbers(tracklet, *"lwh")
    size = np.array([length, width, height])
    class_id = KITTI.get(tracklet.findtext("objectType", ""), 0)
    (first,) = _numbers(tracklet, "first_frame")
    for number, pose in enumerate(tracklet.findall("poses/item"), start=int(first)):
        with reading(path, f"sweep {number}"):
            x, y, z, yaw = _numbers(pose, "tx", "ty", "tz", "rz")
            # The position of a tracklet is the middle of its base; a Box has it in its middle.
            box = Box(planar_pose(x, y, yaw, z + height / 2), size, class_id, track_id)
        yield number, box


def _numbers(element: ElementTree.Element, *names: str) -> list[float]:
    texts = {part.tag: part.text or "" for part in reversed(element)}
    return [float(texts[name]) for name in names]
