"""The pose between two poses, or a little after the second one."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation


def interpolated_pose(
    first: NDArray[np.float64], second: NDArray[np.float64], share: float
) -> NDArray[np.float64]:
    """Moves on from one pose to another with constant velocity and turn rate.

    Args:
        first: (4, 4), the pose at share 0.
        second: (4, 4), the pose at share 1.
        share: Where between them; above 1 the motion goes on.

    Returns:
        (4, 4).
    """
    turn = Rotation.from_matrix(first[:3, :3].T @ second[:3, :3]).as_rotvec()
    pose = np.eye(4)
    pose[:3, :3] = first[:3, :3] @ Rotation.from_rotvec(share * turn).as_matrix()
    pose[:3, 3] = (1.0 - share) * first[:3, 3] + share * second[:3, 3]
    return pose
