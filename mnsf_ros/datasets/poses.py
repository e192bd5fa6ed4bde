"""Poses as the data sets store them: quaternions or matrices."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.recording.poses import is_rigid

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray


def rigid_pose(numbers: ArrayLike) -> NDArray[np.float64]:
    """Returns 16 numbers, row by row, as a (4, 4) float64 pose.

    Raises:
        ValueError: If there are more or fewer, or they are no rotation and translation.
    """
    pose = np.asarray(numbers, dtype=np.float64).reshape(4, 4)
    if not is_rigid(pose):
        raise ValueError(f"pose is no rigid motion: {pose.tolist()}")
    return pose


def poses_from_quaternions(wxyz: ArrayLike, translations: ArrayLike) -> NDArray[np.float64]:
    """Returns the transforms with these rotations and translations.

    Args:
        wxyz: (..., 4) quaternions, the real part first, of any length but 0.
        translations: (..., 3) meters.

    Returns:
        (..., 4, 4) float64.

    Raises:
        ValueError: If a shape is another one or a quaternion is 0.
    """
    quaternions = np.asarray(wxyz, dtype=np.float64)
    positions = np.asarray(translations, dtype=np.float64)
    if quaternions.shape[-1:] != (4,) or positions.shape != (*quaternions.shape[:-1], 3):
        raise ValueError(f"quaternion {quaternions.shape} and position {positions.shape}")
    poses = np.zeros((*quaternions.shape[:-1], 4, 4))
    if quaternions.size:
        xyzw = np.roll(quaternions.reshape(-1, 4), -1, axis=1)
        matrices = Rotation.from_quat(xyzw).as_matrix()
        poses[..., :3, :3] = matrices.reshape(*quaternions.shape[:-1], 3, 3)
    poses[..., :3, 3] = positions
    poses[..., 3, 3] = 1.0
    return poses
