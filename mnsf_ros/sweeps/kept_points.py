# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The points of a sweep that fields are fitted to: inside the crop, and not ground."""

from collections.abc import Sequence

import numpy as np

from mnsf_ros.arrays import Bools, Floats32
from mnsf_ros.compiled import compiled
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.geometry.segmentation import Segmentation
from mnsf_ros.settings import CropSettings, Settings
from mnsf_ros.sweeps.ground_surface import GroundSurface
from mnsf_ros.sweeps.sweep import Sweep

MIN_POINTS = 10
# Farther parts of the own body have boxes of their own, with corners on a grid.
_APART_M = 0.25
_STEP_M = 0.1


def fit_mask(sweep: Sweep, settings: Settings) -> Bools:
    """Mask (N,) of the points that fields are fitted to: the kept ones, or those of the caller.

    Raises:
        SweepError: If too few points are left.
    """
    if sweep.kept is None:
        mask, choice = kept_mask(sweep.xyz, settings), " and ground removal"
    else:
        mask = sweep.kept & crop_mask(sweep.xyz, settings.crop)
        choice = ", ground removal and the choice of points"
    mask &= ~in_boxes(sweep.xyz, settings.crop.own_boxes)
    if (num_left := int(np.count_nonzero(mask))) < MIN_POINTS:
        raise SweepError(
            f"{sweep}: {num_left} of {len(sweep)} points are left after crop"
            f"{choice}, expected at least {MIN_POINTS}"
        )
    return mask


def kept_mask(xyz: Floats32, settings: Settings) -> Bools:
    """Mask (N,) of the points (N, 3), sensor frame, inside the crop and above ground."""
    if not settings.ground.remove:
        return crop_mask(xyz, settings.crop)
    return np.asarray(ground_under(xyz, settings)[1] > settings.ground.margin_m)


def ground_under(xyz: Floats32, settings: Settings) -> tuple[GroundSurface, Floats32]:
    """The ground under points (N, 3), and (N,) metres, how far they are above; NaN if cropped."""
    inside = crop_mask(xyz, settings.crop)
    cropped = chosen_points(xyz, inside)
    ground = GroundSurface(cropped, settings.ground)
    heights = np.full(len(xyz), np.nan, np.float32)
    heights[inside] = ground.heights(cropped)
    return ground, heights


def crop_mask(xyz: Floats32, settings: CropSettings) -> Bools:
    """Mask (N,) of the points (N, 3), sensor frame, within the ranges and heights."""
    return _inside(
        np.require(xyz, requirements=("C", "W")),
        settings.min_range_m**2,
        settings.max_range_m**2,
        np.float32(settings.min_height_m),
        np.float32(settings.max_height_m),
    )


def in_boxes(xyz: Floats32, boxes: Sequence[Sequence[float]]) -> Bools:
    """Mask (N,) of the points (N, 3) in any of the boxes, each a lower and an upper corner."""
    inside = np.zeros(len(xyz), np.bool_)
    for box in boxes:
        low, high = np.array(box, np.float32).reshape(2, 3)
        inside |= ((xyz >= low) & (xyz <= high)).all(axis=1)
    return inside


def boxes_around(xyz: Floats32) -> str:
    """Returns boxes around groups of points (N, 3), as `crop.own_body` has them; empty if none."""
    if len(xyz) == 0:
        return ""
    objects = Segmentation(xyz, _APART_M).objects_of(xyz)
    groups = (xyz[objects == number].astype(np.float64) for number in np.unique(objects))
    corners = (
        (*np.floor(group.min(axis=0) / _STEP_M), *np.ceil(group.max(axis=0) / _STEP_M))
        for group in groups
    )
    return "; ".join(" ".join(f"{_STEP_M * value:.3g}" for value in box) for box in corners)


@compiled("boolean[::1](float32[:, ::1], float64, float64, float32, float32)")
def _inside(
    xyz: Floats32,
    least_squared: float,
    most_squared: float,
    min_height_m: np.float32,
    max_height_m: np.float32,
) -> Bools:
    inside = np.empty(len(xyz), np.bool_)
    # Of a flat array the compiler knows the steps: it looks at several points at once.
    values = xyz.reshape(-1)
    for row in range(len(xyz)):
        # float64: the square of a float32 coordinate of 1e20 is no float32.
        x, y = np.float64(values[3 * row]), np.float64(values[3 * row + 1])
        z, squared = values[3 * row + 2], x * x + y * y
        is_near = (least_squared <= squared) & (squared <= most_squared)
        inside[row] = is_near & (min_height_m <= z) & (z <= max_height_m)
    return inside
