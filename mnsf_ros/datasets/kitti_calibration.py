"""Calibration files of KITTI raw: where the IMU and the camera are, and what the camera sees."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.datasets.errors import DatasetError
from mnsf_ros.datasets.source_files import reading
from mnsf_ros.geometry.transforms import apply, rigid_pose

if TYPE_CHECKING:
    from pathlib import Path

    from numpy.typing import NDArray


@dataclass(frozen=True)
class CameraView:
    """What the left color camera sees of the points of the lidar.

    Attributes:
        image_from_lidar: (3, 4) projection to pixels, homogeneous.
        width, height: Size of the image in pixels.
    """

    image_from_lidar: NDArray[np.float64]
    width: float
    height: float

    def sees(self, xyz: NDArray[np.float32]) -> NDArray[np.bool_]:
        """Returns (N,) bool for (N, 3) points in the lidar frame, in meters."""
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
