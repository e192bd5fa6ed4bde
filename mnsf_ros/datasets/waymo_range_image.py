"""Range images of Waymo Open: from rows, columns and ranges to points of the vehicle."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.datasets.labelled_sweep import Box, LabelledSweep
from mnsf_ros.datasets.source_files import as_type
from mnsf_ros.geometry.transforms import FloatArray, apply, invert

if TYPE_CHECKING:
    from numpy.typing import NDArray

# The vehicle frame of Waymo Open, in which points, boxes and poses are.
FRAME_ID: Final = "vehicle"


@dataclass(frozen=True, eq=False)
class LaserCalibration:
    """How one lidar sits on the vehicle and where its rows look.

    Attributes:
        vehicle_from_laser: (4, 4).
        inclinations_rad: (H,) angle above the horizontal of each row, from the lowest row up;
            empty if rows are spread evenly over the range.
        range_rad: Lowest and highest angle.
    """

    vehicle_from_laser: NDArray[np.float64]
    inclinations_rad: NDArray[np.float64]
    range_rad: tuple[float, float]

    def row_inclinations(self, height: int) -> NDArray[np.float64]:
        """Returns (H,) angles in the order of the rows of an image: from the highest down.

        Raises:
            ValueError: If an image of this height does not fit.
        """
        angles = self.inclinations_rad
        if not len(angles):
            low, high = self.range_rad
            angles = low + (np.arange(height) + 0.5) / height * (high - low)
        if len(angles) != height:
            raise ValueError(f"range image of {height} rows for {len(angles)} inclinations")
        return angles[::-1]


@dataclass(frozen=True, eq=False)
class LaserReturns:
    """One lidar's range image.

    Attributes:
        laser: Number of the lidar; 1 is the one on the roof.
        image: (H, W, 4) float32: range (m), intensity, elongation, 1 in a zone without labels.
        pixel_poses: (H, W, 6) float32: roll, pitch, yaw (rad), x, y, z (m) of the vehicle in
            the world when the pixel was measured; None: all at the same time.
        calibration: Of this lidar.
    """

    laser: int
    image: NDArray[np.float32]
    pixel_poses: NDArray[np.float32] | None
    calibration: LaserCalibration


def shaped(values: NDArray[Any], shape: Sequence[int], channels: int) -> NDArray[np.float32]:
    """Returns flat values as an image.

    Raises:
        ValueError: If it is none of so many channels at least, or the number of values differs.
    """
    if len(shape) != 3 or shape[2] < channels:
        raise ValueError(f"range image of shape {list(shape)}, expected (H, W, {channels})")
    return np.asarray(values, dtype=np.float32).reshape(tuple(shape))


def waymo_sweep(
    stamp_ns: int,
    world_from_vehicle: FloatArray,
    returns: Sequence[LaserReturns],
    boxes: tuple[Box, ...] | None,
) -> LabelledSweep:
    """Returns the first returns of all lidars as one sweep in the vehicle frame.

    Raises:
        ValueError: If an image does not fit its calibration, or the sweep is refused.
        FloatingPointError: If a point is too far away for a float32.
    """
    points, numbers, measured = [], [], []
    for laser in sorted(returns, key=lambda one: one.laser):
        rows, columns = np.nonzero(laser.image[:, :, 0] > 0)
        points.append(_points(laser, rows, columns, world_from_vehicle))
        measured.append(laser.image[rows, columns])
        numbers.append(np.full(len(rows), laser.laser, dtype=np.uint8))
    values = np.concatenate(measured) if measured else np.zeros((0, 4), dtype=np.float32)
    xyz = np.concatenate(points) if points else np.zeros((0, 3))
    return LabelledSweep(
        stamp_ns=stamp_ns,
        xyz=as_type(xyz, np.float32),
        columns={
            "intensity": np.ascontiguousarray(values[:, 1]),
            "elongation": np.ascontiguousarray(values[:, 2]),
            "laser": np.concatenate([*numbers, np.zeros(0, dtype=np.uint8)]),
        },
        pose=world_from_vehicle,
        boxes=boxes,
        labelled=values[:, 3] <= 0,
    )


def _points(
    laser: LaserReturns,
    rows: NDArray[np.intp],
    columns: NDArray[np.intp],
    world_from_vehicle: FloatArray,
) -> FloatArray:
    height, width = laser.image.shape[:2]
    mount = laser.calibration.vehicle_from_laser
    # The middle column looks to the front of the vehicle, not of the lidar.
    turn = math.atan2(mount[1, 0], mount[0, 0])
    azimuth = ((width - columns - 0.5) / width * 2 - 1) * math.pi - turn
    inclination = laser.calibration.row_inclinations(height)[rows]
    distance = laser.image[rows, columns, 0].astype(np.float64)
    level = distance * np.cos(inclination)
    local = np.stack(
        [level * np.cos(azimuth), level * np.sin(azimuth), distance * np.sin(inclination)], axis=1
    )
    points = apply(mount, local)
    if laser.pixel_poses is None:
        return points
    if laser.pixel_poses.shape[:2] != (height, width):
        raise ValueError(f"poses of {laser.pixel_poses.shape} for an image of {height}, {width}")
    pose = laser.pixel_poses[rows, columns].astype(np.float64)
    if len(pose):
        points = Rotation.from_euler("ZYX", pose[:, 2::-1]).apply(points) + pose[:, 3:6]
        points = apply(invert(world_from_vehicle), points)
    return points
