"""KITTI raw: a drive with synchronized sweeps, calibration, GPS/IMU and tracklets."""

from __future__ import annotations

import math
from collections import defaultdict
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final
from xml.etree import ElementTree

import numpy as np

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep, SweepSource
from mnsf_ros.datasets.source_files import files_in, read_float_rows, reading, stamp_in
from mnsf_ros.datasets.surface_classes import kitti_class
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import apply, invert, planar_pose, rigid_pose, tilt

if TYPE_CHECKING:
    from collections.abc import Iterator, Mapping
    from pathlib import Path

    from numpy.typing import NDArray

    from mnsf_ros.datasets.formats import ReadOptions


@dataclass(frozen=True)
class CameraView:
    """What the left colour camera sees of the points of the lidar.

    Attributes:
        image_from_lidar: (3, 4) projection to pixels, homogeneous.
        width, height: Size of the image in pixels.
    """

    image_from_lidar: NDArray[np.float64]
    width: float
    height: float

    def sees(self, xyz: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns (N,) bool for (N, 3) points in the lidar frame, in metres."""
        with np.errstate(invalid="ignore"):
            u, v, depth = apply(self.image_from_lidar, xyz.astype(np.float64)).T
        # Not divided by the depth, which may be zero.
        inside: NDArray[np.bool_] = (
            (depth > 0) & (u >= 0) & (u < self.width * depth) & (v >= 0) & (v < self.height * depth)
        )
        return inside


def read_rigid(path: Path) -> NDArray[np.float64]:
    """Returns the (4, 4) transform of a calibration file with R and T.

    Raises:
        DatasetError: If the file is missing, has no such entries, or R is no rotation.
    """
    entries = _read_entries(path)
    transform = np.eye(4)
    transform[:3, :3] = _entry(path, entries, "R", (3, 3))
    transform[:3, 3] = _entry(path, entries, "T", (3,))
    with reading(path):
        return rigid_pose(transform)


def read_camera_view(folder: Path) -> CameraView:
    """Returns the view of the camera in whose image objects were labelled.

    Args:
        folder: The folder of a day, with `calib_velo_to_cam.txt` and `calib_cam_to_cam.txt`.

    Raises:
        DatasetError: If one is missing or incomplete.
    """
    path = folder / "calib_cam_to_cam.txt"
    entries = _read_entries(path)
    rectified = np.eye(4)
    rectified[:3, :3] = _entry(path, entries, "R_rect_00", (3, 3))
    width, height = _entry(path, entries, "S_rect_02", (2,))
    projection = _entry(path, entries, "P_rect_02", (3, 4))
    lidar_to_camera = read_rigid(folder / "calib_velo_to_cam.txt")
    return CameraView(projection @ rectified @ lidar_to_camera, float(width), float(height))


def _read_entries(path: Path) -> dict[str, str]:
    with reading(path):
        lines = path.read_text(encoding="ascii").splitlines()
    pairs = (line.partition(":") for line in lines)
    return {name.strip(): values for name, colon, values in pairs if colon}


def _entry(
    path: Path, entries: dict[str, str], name: str, shape: tuple[int, ...]
) -> NDArray[np.float64]:
    if name not in entries:
        raise DatasetError(f"{path}: has no entry {name!r}; it has {', '.join(entries)}")
    with reading(path):
        return np.array([float(word) for word in entries[name].split()]).reshape(shape)


def read_tracklets(path: Path) -> dict[int, tuple[Box, ...]]:
    """Returns the boxes in the lidar frame by the number of their sweep.

    Raises:
        DatasetError: If the file is missing, damaged or no tracklet file.
    """
    boxes: dict[int, list[Box]] = defaultdict(list)
    with reading(path):
        root = ElementTree.parse(path).getroot()
        tracklets = root.find("tracklets")
        if tracklets is None:
            raise ValueError("has no element 'tracklets'")
        for track_id, tracklet in enumerate(tracklets.findall("item")):
            for number, box in _boxes_of(path, tracklet, track_id):
                boxes[number].append(box)
    return {number: tuple(found) for number, found in boxes.items()}


def _boxes_of(
    path: Path, tracklet: ElementTree.Element, track_id: int
) -> Iterator[tuple[int, Box]]:
    height = _number(tracklet, "h")
    size = np.array([_number(tracklet, "l"), _number(tracklet, "w"), height])
    class_id = kitti_class(tracklet.findtext("objectType", ""))
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
