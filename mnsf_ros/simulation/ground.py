"""Where rays meet the asphalt, the sidewalks and the curbs between them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.simulation.bodies import SurfaceClass
from mnsf_ros.simulation.street import CURB_HEIGHT_M, Street

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mnsf_ros.geometry.transforms import FloatArray

_BISECTIONS = 14


def ground_hits(
    street: Street, origin: FloatArray, directions: FloatArray, max_range_m: float
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Find where rays meet the ground.

    Args:
        street: The ground plan.
        origin: (3,) start of all rays in world meters, above the sidewalks.
        directions: (N, 3) unit directions in the world frame.
        max_range_m: Longer rays count as misses.

    Returns:
        (N,) ranges in meters, `inf` for misses, and (N,) surface classes, 0 for misses.
    """
    ranges = np.full(len(directions), np.inf)
    classes = np.zeros(len(directions), dtype=np.uint8)
    down = np.flatnonzero(directions[:, 2] < -(origin[2] - CURB_HEIGHT_M) / max_range_m)
    rays = directions[down]
    top = (CURB_HEIGHT_M - origin[2]) / rays[:, 2]
    bottom = -origin[2] / rays[:, 2]
    on_top = _raised(street, origin, rays, top)
    # A ray that dips below sidewalk level over asphalt and ends under a sidewalk met a curb.
    curb = np.flatnonzero(~on_top)[_raised(street, origin, rays[~on_top], bottom[~on_top])]
    found = np.where(on_top, top, bottom)
    found[curb] = _curb_ranges(street, origin, rays[curb], top[curb], bottom[curb])
    sidewalk = on_top.copy()
    sidewalk[curb] = True
    ranges[down] = np.where(found <= max_range_m, found, np.inf)
    classes[down] = np.where(sidewalk, SurfaceClass.SIDEWALK, SurfaceClass.ROAD)
    classes[~np.isfinite(ranges)] = 0
    return ranges, classes


def _raised(
    street: Street, origin: FloatArray, directions: FloatArray, ranges: FloatArray
) -> NDArray[np.bool_]:
    x = origin[0] + ranges * directions[:, 0]
    y = origin[1] + ranges * directions[:, 1]
    return street.is_raised(x, y)


def _curb_ranges(
    street: Street,
    origin: FloatArray,
    directions: FloatArray,
    before: FloatArray,
    behind: FloatArray,
) -> FloatArray:
    """Return where rays cross the curb between a range over asphalt and one under a sidewalk."""
    for _ in range(_BISECTIONS):
        middle = (before + behind) / 2
        raised = _raised(street, origin, directions, middle)
        before, behind = np.where(raised, before, middle), np.where(raised, middle, behind)
    return behind
