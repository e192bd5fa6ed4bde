"""Poses in messages <-> (4, 4) matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.errors import RecordingError

if TYPE_CHECKING:
    from numpy.typing import NDArray

_NORM_TOLERANCE = 1e-3
_RIGID_TOLERANCE = 1e-3


class PointLike(Protocol):
    """Any object with the attributes of geometry_msgs/Point, in meters."""

    x: float
    y: float
    z: float


class QuaternionLike(Protocol):
    """Any object with the attributes of geometry_msgs/Quaternion."""

    x: float
    y: float
    z: float
    w: float


class PoseLike(Protocol):
    """Any object with the attributes of geometry_msgs/Pose."""

    @property
    def position(self) -> PointLike:
        """Origin of the moving frame."""

    @property
    def orientation(self) -> QuaternionLike:
        """Rotation of the moving frame."""


def is_rigid(pose: NDArray[np.floating[Any]]) -> bool:
    """Whether a matrix is (4, 4), finite, and turns and shifts but does nothing else."""
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        return False
    turn = pose[:3, :3].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        excess = np.abs(turn @ turn.T - np.eye(3)).max()
        last_row = np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max()
        # A mirrored frame has all its axes at right angles, too.
        is_proper = np.linalg.det(turn) > 0
    return bool(excess <= _RIGID_TOLERANCE and last_row <= _RIGID_TOLERANCE and is_proper)


def quaternion_of(pose: NDArray[np.floating[Any]]) -> tuple[float, float, float, float]:
    """Return x, y, z, w of the rotation of a (4, 4) pose, w at least 0.

    Raises:
        RecordingError: The matrix is no rigid motion.
    """
    if not is_rigid(pose):
        raise RecordingError(f"pose is no rigid motion: {pose.tolist()}")
    x, y, z, w = Rotation.from_matrix(pose[:3, :3]).as_quat()
    sign = -1.0 if w < 0 else 1.0
    return float(sign * x), float(sign * y), float(sign * z), float(sign * w)


def matrix_of(pose: PoseLike) -> NDArray[np.float64]:
    """Return the (4, 4) matrix of a geometry_msgs/Pose.

    Raises:
        RecordingError: A number is not finite, or the quaternion is not of length 1.
    """
    p, q = pose.position, pose.orientation
    position = np.array([p.x, p.y, p.z], dtype=np.float64)
    quaternion = np.array([q.x, q.y, q.z, q.w], dtype=np.float64)
    if not (np.isfinite(position).all() and np.isfinite(quaternion).all()):
        raise RecordingError(f"pose is not finite: position {position}, quaternion {quaternion}")
    length = float(np.linalg.norm(quaternion))
    if abs(length - 1.0) > _NORM_TOLERANCE:
        raise RecordingError(f"quaternion {quaternion} has length {length:.4g}, expected 1")
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = position
    return matrix
