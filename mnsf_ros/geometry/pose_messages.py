# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses in messages to and from (4, 4) matrices, with one tolerance."""

from __future__ import annotations

from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from mnsf_ros.geometry.transforms import FloatArray, is_rigid
from msg_utils.errors import MessageError

# Any object with the attributes of geometry_msgs/Pose.
PoseLike: TypeAlias = Any
# ... and of geometry_msgs/Transform.
TransformLike: TypeAlias = Any

# Drivers round quaternions to float32 or a few decimals: those are normalised. Outside of these
# bounds the four numbers are something else, mostly all zeros.
_MIN_NORM: Final = 0.5
_MAX_NORM: Final = 1.5
_FARTHEST_M: Final = 1e9  # the difference of two such positions is good to a micrometre


def pose_matrix(pose: PoseLike) -> NDArray[np.float64]:
    """Returns the (4, 4) matrix of a geometry_msgs/Pose.

    A quaternion of a norm from 0.5 to 1.5 is normalised.

    Raises:
        MessageError: A number is not finite, the position is 1e9 m or more from the origin, or the
            quaternion has another norm.
    """
    return _matrix(pose.position, pose.orientation)


def transform_matrix(transform: TransformLike) -> NDArray[np.float64]:
    """Returns the (4, 4) matrix of a geometry_msgs/Transform, see `pose_matrix`.

    Raises:
        MessageError: As for poses.
    """
    return _matrix(transform.translation, transform.rotation)


def _matrix(p: Any, q: Any) -> NDArray[np.float64]:  # noqa: ANN401 - parts of such messages
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


def pose_quaternion(matrix: FloatArray) -> tuple[float, float, float, float]:
    """Returns x, y, z, w of the rotation of a (4, 4) pose, w at least 0.

    Raises:
        MessageError: The matrix is not a rigid motion.
    """
    if not is_rigid(matrix):
        raise MessageError(f"pose is no rigid motion: {matrix.tolist()}")
    x, y, z, w = Rotation.from_matrix(matrix[:3, :3]).as_quat()
    sign = -1.0 if w < 0 else 1.0
    return float(sign * x), float(sign * y), float(sign * z), float(sign * w)
