# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rigid transforms as (4, 4) float64 `destination_from_source`, and poses in messages."""

import math
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.settings import EgoMotionSettings, LidarSettings
from msg_utils.errors import MessageError

_RIGID_TOLERANCE: Final = 1e-3
# Any object with the attributes of geometry_msgs/Pose.
PoseLike: TypeAlias = Any
# ... and of geometry_msgs/Transform.
TransformLike: TypeAlias = Any

# Drivers round quaternions to float32 or a few decimals: those are normalised. Outside of these
# bounds the four numbers are something else, mostly all zeros.
_MIN_NORM: Final = 0.5
_MAX_NORM: Final = 1.5
_FARTHEST_M: Final = 1e9  # the difference of two such positions is good to a micrometre


def planar_pose(x: float, y: float, yaw: float, z: float = 0.0) -> AnyFloats:
    """Returns the (4, 4) pose at (x, y, z) in metres, turned by `yaw` radians about +z."""
    cos, sin = math.cos(yaw), math.sin(yaw)
    return np.array(
        [[cos, -sin, 0.0, x], [sin, cos, 0.0, y], [0.0, 0.0, 1.0, z], [0.0, 0.0, 0.0, 1.0]]
    )


def turned_yaw(turn: AnyFloats, yaw: float) -> float:
    """Returns the yaw, as seen in axes turned by (3, 3), of a horizontal direction of yaw `yaw`."""
    x, y, _ = turn @ (math.cos(yaw), math.sin(yaw), 0.0)
    return math.atan2(y, x)


def tilt(pitch: float, roll: float) -> AnyFloats:
    """Returns the (4, 4) rotation by `roll` about x, then by `pitch` about y, in radians."""
    cos_p, sin_p = math.cos(pitch), math.sin(pitch)
    cos_r, sin_r = math.cos(roll), math.sin(roll)
    about_y = np.array([[cos_p, 0.0, sin_p], [0.0, 1.0, 0.0], [-sin_p, 0.0, cos_p]])
    about_x = np.array([[1.0, 0.0, 0.0], [0.0, cos_r, -sin_r], [0.0, sin_r, cos_r]])
    pose = np.eye(4)
    pose[:3, :3] = about_y @ about_x
    return pose


def sensor_mount(settings: EgoMotionSettings) -> Floats:
    """Returns robot_from_sensor (4, 4); the robot is the moving frame of the odometry."""
    angles_deg = (settings.sensor_yaw_deg, settings.sensor_pitch_deg, settings.sensor_roll_deg)
    return _mounted((settings.sensor_x_m, settings.sensor_y_m, settings.sensor_z_m), angles_deg)


def mounted_at(settings: LidarSettings) -> Floats:
    """Returns frame_from_lidar (4, 4) of the settings."""
    angles_deg = (settings.yaw_deg, settings.pitch_deg, settings.roll_deg)
    return _mounted((settings.x_m, settings.y_m, settings.z_m), angles_deg)


def _mounted(position_m: ArrayLike, angles_deg: ArrayLike) -> Floats:
    """Returns the (4, 4) pose at a position, turned by yaw, then pitch, then roll."""
    pose = np.eye(4)
    pose[:3, :3] = Rotation.from_euler("ZYX", angles_deg, degrees=True).as_matrix()
    pose[:3, 3] = position_m
    return pose


def invert(pose: AnyFloats) -> AnyFloats:
    """Returns the inverse of a rigid (4, 4) transform."""
    inverse = np.eye(4)
    inverse[:3, :3] = pose[:3, :3].T
    inverse[:3, 3] = -pose[:3, :3].T @ pose[:3, 3]
    return inverse


def apply(pose: AnyFloats, points: AnyFloats) -> AnyFloats:
    """Returns (N, 3) points transformed by a (4, 4) matrix."""
    return points @ pose[:3, :3].T + pose[:3, 3]


def interpolated_pose(first: AnyFloats, second: AnyFloats, share: float) -> Floats:
    """Returns the pose at a share of the way between two, at constant velocity and turn rate.

    Shares below 0 (the first pose) and above 1 (the second) extrapolate the motion.
    """
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    pose = np.eye(4)
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    pose[:3, 3] = (1.0 - share) * first[:3, 3] + share * second[:3, 3]
    return pose


def is_rigid(pose: AnyFloats) -> bool:
    """Returns whether a matrix is (4, 4), finite, and a rotation and a translation only."""
    if pose.shape != (4, 4) or not np.isfinite(pose).all():
        return False
    turn = pose[:3, :3].astype(np.float64)
    with np.errstate(over="ignore", invalid="ignore"):
        excess = np.abs(turn @ turn.T - np.eye(3)).max()
        last_row = np.abs(pose[3] - (0.0, 0.0, 0.0, 1.0)).max()
        # The axes of a mirrored frame are orthogonal, too.
        is_proper = np.linalg.det(turn) > 0
    return bool(excess <= _RIGID_TOLERANCE and last_row <= _RIGID_TOLERANCE and is_proper)


def rigid_pose(numbers: ArrayLike) -> Floats:
    """Returns 16 numbers, row by row, as a (4, 4) float64 pose.

    Raises:
        ValueError: The count differs, or they are not a rigid motion.
    """
    pose = np.asarray(numbers, dtype=np.float64).reshape(4, 4)
    if not is_rigid(pose):
        raise ValueError(f"pose is no rigid motion: {pose.tolist()}")
    return pose


def poses_from_quaternions(wxyz: ArrayLike, translations: ArrayLike) -> Floats:
    """Returns the transforms (..., 4, 4) with these rotations and translations (..., 3).

    The quaternions (..., 4) have the real part first and may have any length but 0.

    Raises:
        ValueError: A shape differs or a quaternion is 0.
    """
    quaternions = np.asarray(wxyz, dtype=np.float64)
    outer = quaternions.shape[:-1]
    poses = np.tile(np.eye(4), (*outer, 1, 1))
    poses[..., :3, 3] = np.reshape(translations, (*outer, 3))
    if quaternions.size:
        turns = Rotation.from_quat(np.roll(quaternions.reshape(-1, 4), -1, axis=1))
        poses[..., :3, :3] = turns.as_matrix().reshape(*outer, 3, 3)
    return poses


def pose_matrix(pose: PoseLike) -> Floats:
    """Returns the (4, 4) matrix of a geometry_msgs/Pose.

    A quaternion of a norm from 0.5 to 1.5 is normalised.

    Raises:
        MessageError: A number is not finite, the position is 1e9 m or more from the origin, or the
            quaternion has another norm.
    """
    return _matrix(pose.position, pose.orientation)


def transform_matrix(transform: TransformLike) -> Floats:
    """Returns the (4, 4) matrix of a geometry_msgs/Transform, see `pose_matrix`.

    Raises:
        MessageError: As for poses.
    """
    return _matrix(transform.translation, transform.rotation)


def _matrix(p: Any, q: Any) -> Floats:  # noqa: ANN401 - parts of such messages
    position = np.array([p.x, p.y, p.z], dtype=np.float64)
    quaternion = np.array([q.x, q.y, q.z, q.w], dtype=np.float64)
    if not (np.abs(position) < _FARTHEST_M).all():
        raise MessageError(
            f"invalid position {position.tolist()}, expected metres below {_FARTHEST_M:g}"
        )
    with np.errstate(over="ignore"):
        norm = float(np.linalg.norm(quaternion))
    if not _MIN_NORM < norm < _MAX_NORM:
        raise MessageError(
            f"invalid quaternion {quaternion.tolist()} (norm {norm:.4g}, expected 1)"
        )
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = position
    return matrix


def pose_quaternion(matrix: AnyFloats) -> tuple[float, float, float, float]:
    """Returns x, y, z, w of the rotation of a (4, 4) pose, w at least 0.

    Raises:
        MessageError: The matrix is not a rigid motion.
    """
    if not is_rigid(matrix):
        raise MessageError(f"pose is no rigid motion: {matrix.tolist()}")
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    sign = -1.0 if w < 0 else 1.0
    return float(sign * x), float(sign * y), float(sign * z), float(sign * w)
