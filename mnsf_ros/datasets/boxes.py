"""Which points belong to which box."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.geometry.transforms import apply, invert

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mnsf_ros.datasets.labelled_sweep import Box


def box_of_points(
    xyz: NDArray[np.float32], boxes: Sequence[Box], margin_m: float, ground: NDArray[np.bool_]
) -> NDArray[np.int64]:
    """Finds the box that each point belongs to.

    Labelled boxes are tight, so points a little outside belong to them, too; but the ground
    around an object does not move along with it. A point that several boxes reach belongs to
    the one that it is deepest inside.

    Args:
        xyz: (N, 3) meters. A row that is not finite belongs to no box.
        boxes: Boxes in the frame of the points; hidden ones own no points.
        margin_m: By how much the length, the width and the height of a box grow, in meters:
            half of it on either side.
        ground: (N,) bool, points that belong to a box only if inside it as labelled.

    Returns:
        (N,) index into `boxes`, -1 for no box.
    """
    owner = np.full(len(xyz), -1, dtype=np.int64)
    overshoot = np.full(len(xyz), np.inf)
    x, y = np.ascontiguousarray(xyz[:, 0]), np.ascontiguousarray(xyz[:, 1])
    for number, box in enumerate(boxes):
        if box.hidden:
            continue
        reach = float(np.linalg.norm(box.size_m + margin_m)) / 2
        near = (np.abs(x - box.pose[0, 3]) <= reach) & (np.abs(y - box.pose[1, 3]) <= reach)
        rows = np.flatnonzero(near)
        local = apply(invert(box.pose), xyz[rows].astype(np.float64))
        outside = (np.abs(local) - box.size_m / 2).max(axis=1)
        allowed = np.where(ground[rows], 0.0, margin_m / 2)
        mine = (outside <= allowed) & (outside < overshoot[rows])
        owner[rows[mine]] = number
        overshoot[rows[mine]] = outside[mine]
    return owner
