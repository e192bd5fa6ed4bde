# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The colours of motion in pictures and clouds: direction is the hue."""

import colorsys
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.compiled import compiled

Color = tuple[float, float, float]

# Colours are full from this speed on.
FULL_COLOR_M_S: Final = 5.0
# Errors have their full colour from here on, metres a sweep.
FULL_ERROR_M: Final = 0.3
# From no error over a large one to an outlier.
_ERROR_RAMP: Final = np.array([[52, 58, 72], [226, 176, 44], [255, 58, 40]], np.float64)
# RGB of static points.
SLOW: Final[Color] = (0.36, 0.38, 0.42)

# Number of directions and lengths of packed colours.
_NUM_HUES: Final = 360
_NUM_STRENGTHS: Final = 64
_HUE_STEP: Final = 0.618  # of a turn, from object to object


def flow_colors(flow: NDArray[Any], full_speed_m: float) -> Floats:
    """Returns the colour of each flow vector: direction is the hue, speed is the saturation.

    Red is +x (forward), then around through yellow-green (+y, left), cyan (-x) and violet (-y).
    Opposite directions have opposite hues. The colour fades to grey as the vector shortens.

    Flow is (N, 2) or wider, colours are (N, 3) RGB, each 0 to 1. They are full from `full_speed_m`
    on, in the unit of the flow.
    """
    x, y = flow[:, 0].astype(np.float64), flow[:, 1].astype(np.float64)
    speeds = np.hypot(x, y)
    strengths = np.clip(speeds / full_speed_m, 0.0, 1.0)
    finite = np.isfinite(speeds)
    strengths[~finite] = 0.0
    sixths = np.where(finite, np.arctan2(y, x), 0.0) * (3.0 / np.pi)  # hue, 6 is a full turn
    # Red, green and blue are the same hat over the hue, a third of a turn apart.
    from_peak = np.abs((sixths[:, None] - [0.0, 2.0, 4.0] + 3.0) % 6.0 - 3.0)
    hues = np.clip(2.0 - from_peak, 0.0, 1.0)
    return np.asarray(SLOW) + strengths[:, None] * (hues - SLOW)


def wheel_image(num_pixels: int) -> Floats:
    """Returns the wheel of colours, x to the right and y up, full colour on its rim.

    (P, P, 4) RGBA for P pixels, each 0 to 1, first row on top, transparent outside of the wheel;
    colours depend on the root of the length, as in `packed_colors`.
    """
    across = np.linspace(-1.0, 1.0, num_pixels)
    x, y = np.meshgrid(across, across[::-1])
    radius = np.hypot(x, y)
    scale = 1.0 / np.sqrt(np.maximum(radius, 1e-9))
    colors = flow_colors(np.column_stack([(scale * x).ravel(), (scale * y).ravel()]), 1.0)
    # The rim fades over one pixel, so that it is not jagged.
    opacities = np.clip((1.0 - radius) * (num_pixels / 2), 0.0, 1.0)
    return np.dstack([colors.reshape(num_pixels, num_pixels, 3), opacities])


def packed_colors(motion: Floats32, full_length_m: float) -> NDArray[np.uint32]:
    """Returns the colours (N,) of motions (N, 3) in metres, packed as 0x00RRGGBB.

    The colours of `flow_colors` for the root of the length, so that a pedestrian shows beside cars.
    From `full_length_m` on, metres above 0, the colour is full.
    """
    return _looked_up(np.ascontiguousarray(motion), np.float32(1 / full_length_m), _TABLE)


def error_colors_rgb(errors_m: NDArray[Any]) -> Floats:
    """Returns (N, 3) RGB, each 0 to 255, of errors (N,) in metres; NaN has the colour of 0."""
    place = np.nan_to_num(np.clip(errors_m / FULL_ERROR_M, 0.0, 1.0)) * 2
    return np.column_stack([np.interp(place, (0, 1, 2), ramp) for ramp in _ERROR_RAMP.T])


def object_color(number: int) -> Color:
    """Returns the colour of an object by its number; neighbouring numbers differ most."""
    return colorsys.hsv_to_rgb(number * _HUE_STEP % 1, 0.7, 1.0)


def _table() -> NDArray[np.uint32]:
    """(_NUM_HUES, _NUM_STRENGTHS) packed colours, from -x around, and from none to full."""
    angles = (np.arange(_NUM_HUES) + 0.5) * (2 * np.pi / _NUM_HUES) - np.pi
    strengths = np.linspace(0.0, 1.0, _NUM_STRENGTHS)
    directions = np.column_stack([np.cos(angles), np.sin(angles)])
    vectors = directions[:, None] * strengths[:, None]
    levels = np.rint(255 * flow_colors(vectors.reshape(-1, 2), 1.0)).astype(np.uint32)
    packed: NDArray[np.uint32] = levels @ np.array([2**16, 2**8, 1], np.uint32)
    return packed.reshape(_NUM_HUES, _NUM_STRENGTHS)


@compiled("uint32[::1](float32[:, ::1], float32, uint32[:, ::1])")
def _looked_up(
    motion: Floats32, per_length: np.float32, table: NDArray[np.uint32]
) -> NDArray[np.uint32]:
    """Returns the entry of the table for each motion (N, 3); the first one for zero and NaN."""
    num_hues, num_strengths = table.shape
    result = np.full(len(motion), table[0, 0], np.uint32)
    for row in range(len(motion)):
        x, y = np.float64(motion[row, 0]), np.float64(motion[row, 1])
        if x == 0 and y == 0:  # most points are static
            continue
        strength = np.sqrt(np.sqrt(x * x + y * y) * per_length)
        if not strength < np.inf:
            continue
        column = int(min(strength, 1.0) * (num_strengths - 1) + 0.5)
        turn = (np.arctan2(y, x) + np.pi) / (2 * np.pi)
        hue = min(max(int(turn * num_hues), 0), num_hues - 1)
        result[row] = table[hue, column]
    return result


_TABLE: Final = _table()
