"""Rigid transforms as (4, 4) float64 matrices, named `destination_from_source`."""

from __future__ import annotations

import math
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

FloatArray: TypeAlias = NDArray[np.floating[Any]]


def planar_pose(x: float, y: float, yaw: float, z: float = 0.0) -> FloatArray:
    """Return the (4, 4) pose at (x, y, z) in meters, turned by `yaw` radians about +z."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array(
        [[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]]
    )


def tilt(pitch: float, roll: float) -> FloatArray:
    """Return the (4, 4) rotation by `roll` about x, then by `pitch` about y, in radians."""
    cos_p, sin_p = math.cos(pitch), math.sin(pitch)
    cos_r, sin_r = math.cos(roll), math.sin(roll)
    about_y = np.array([[cos_p, 0.0, sin_p], [0.0, 1.0, 0.0], [-sin_p, 0.0, cos_p]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_r, -sin_r], [0.0, sin_r, cos_r]])
    pose = np.eye(4)
    pose[:3, :3] = about_y @ about_x
    return pose


def invert(pose: FloatArray) -> FloatArray:
    """Return the inverse of a rigid (4, 4) transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def apply(pose: FloatArray, points: FloatArray) -> FloatArray:
    """Return (N, 3) points carried by the (4, 4) transform."""
    return points @ pose[:3, :3].T + pose[:3, 3]
