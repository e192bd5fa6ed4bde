# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Intersections of rays with asphalt, sidewalks and curbs, and the intensity of points."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.street import CURB_HEIGHT_M, PARKING_LATERAL_M, Street

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from mnsf_ros.geometry.transforms import FloatArray

_BISECTIONS = 14


def ground_hits(
    street: Street, origin: FloatArray, directions: FloatArray, max_range_m: float
) -> tuple[FloatArray, NDArray[np.uint8]]:
    """Returns (N,) ranges to the ground, `inf` for misses, and (N,) surface classes, 0 there.

    The rays start at (3,) world metres, above the sidewalks, in (N, 3) unit directions; those
    longer than `max_range_m` are misses.
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
    """Returns the ranges at which rays meet the curb, between asphalt and sidewalk."""
    for _ in range(_BISECTIONS):
        middle = (before + behind) / 2
        raised = _raised(street, origin, directions, middle)
        before, behind = np.where(raised, before, middle), np.where(raised, middle, behind)
    return behind


_ASPHALT, _SIDEWALK, _PAINT = 22.0, 48.0, 150.0
_SPECKLE = 5.0


def intensities(
    street: Street,
    world: FloatArray,
    class_id: NDArray[np.uint8],
    reflectivity: FloatArray,
    rng: np.random.Generator,
) -> NDArray[np.float32]:
    """Returns (N,) intensities from 0 to 255 of points (N, 3) in world metres, with speckle.

    The (N,) reflectivity is the mean intensity of the body each point is on, ignored on the ground.
    """
    brightness = reflectivity.copy()
    brightness[class_id == SurfaceClass.SIDEWALK] = _SIDEWALK
    road = np.flatnonzero(class_id == SurfaceClass.ROAD)
    painted = _is_painted(street, world[road, 0], world[road, 1])
    brightness[road] = np.where(painted, _PAINT, _ASPHALT)
    brightness += rng.normal(0.0, _SPECKLE, len(brightness))
    return np.clip(brightness, 0.0, 255.0).astype(np.float32)


def _is_painted(street: Street, x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
    """Mask of places on the asphalt with a center dash, a parking line or a zebra crossing."""
    lateral = street.centerline.lateral(x, y)
    dashes = (np.abs(lateral) < 0.08) & (x % 9.0 < 4.0)
    parking = np.abs(np.abs(lateral) - (PARKING_LATERAL_M - 1.15)) < 0.06
    painted = dashes | parking
    for crossing in street.crossings:
        along = crossing.along(x, y)
        painted &= np.abs(along) > 9.0
        painted |= (np.abs(along + 7.0) < 1.4) & (lateral % 1.0 < 0.5)
    return painted
