# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of sweeps in perspective, moving points coloured, side by side and as an animation."""

import io
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mnsf_ros.arrays import AnyFloats, Floats, Floats32, Ints
from mnsf_ros.drawing.color_wheel import (
    FULL_ERROR_M,
    error_colors_rgb,
    packed_colors,
    wheel_image,
)

# Of one of several pictures side by side.
_WIDTH_PX: Final = 560
_HEIGHT_PX: Final = 300
_GAP_PX: Final = 4
_GAP_COLOR: Final = (90, 98, 110)
_SCALE: Final = 3  # drawn larger, for smooth edges
_BACKGROUND: Final = np.array([13, 15, 20], np.uint8)
_INK: Final = (225, 228, 232)
_FAINT: Final = (140, 147, 156)
# The camera is behind and above the sensor and looks ahead and down.
_CAMERA: Final = np.array([-17.0, 0.0, 17.0])
_PITCH_DEG: Final = 35.0
_FOCAL_PX: Final = 395.0 * _SCALE
_NEAREST_M: Final = 2.0
_FARTHEST_M: Final = 120.0
_GROUND_M: Final = -1.8  # usual height below the lidar of a car
_STATIC_PX: Final = 2
_MOVING_PX: Final = 4
_WHEEL_PX: Final = 50
# Of the picture from above: half of its sides, brightness of points without error, the sensor.
ABOVE_M: Final = 50.0
_UNKNOWN: Final = 0.5
_ARROW_PX: Final = ((0, -6), (4, 5), (0, 2), (-4, 5))


def frame(
    xyz: Floats32,
    velocities: Sequence[Floats32],
    full_speed_m_s: float,
    errors_m: AnyFloats | None = None,
) -> bytes:
    """Returns a PNG file of a sweep, once for each velocity, and its errors from above.

    Points (N, 3) are metres in the sensor frame, x forward; velocities (N, 3) m/s over ground, of
    full colour from a speed on; errors (N,) NaN where unknown.
    """
    above = [] if errors_m is None else [_from_above(xyz, errors_m)]
    width = len(velocities) * (_WIDTH_PX + _GAP_PX) - _GAP_PX
    width += len(above) * (_HEIGHT_PX + _GAP_PX)
    whole = Image.new("RGB", (width, _HEIGHT_PX), _GAP_COLOR)
    for place, velocity in enumerate(velocities):
        image = Image.fromarray(_points(xyz, velocity, full_speed_m_s))
        _draw_sensor(ImageDraw.Draw(image))
        image = image.resize((_WIDTH_PX, _HEIGHT_PX), Image.Resampling.BOX)
        _draw_legend(image, full_speed_m_s)
        whole.paste(image, (place * (_WIDTH_PX + _GAP_PX), 0))
    for image in above:
        whole.paste(image, (width - _HEIGHT_PX, 0))
    content = io.BytesIO()
    whole.save(content, "PNG")
    return content.getvalue()


def _from_above(xyz: Floats32, errors_m: AnyFloats) -> Image.Image:
    """A square picture, ahead is up, the largest errors on top, unknown ones darker."""
    canvas = np.empty((_SCALE * _HEIGHT_PX, _SCALE * _HEIGHT_PX, 3), np.uint8)
    canvas[:] = _BACKGROUND
    pixels_per_m = _SCALE * _HEIGHT_PX / (2 * ABOVE_M)
    pixels = _SCALE * _HEIGHT_PX / 2 - pixels_per_m * xyz[:, 1::-1].astype(np.float64)
    known = np.isfinite(errors_m)
    colors = error_colors_rgb(errors_m) * np.where(known, 1.0, _UNKNOWN)[:, None]
    order = np.argsort(np.where(known, errors_m, -1.0), kind="stable")
    is_large = errors_m[order] > FULL_ERROR_M / 2
    for rows, size in ((order[~is_large], _STATIC_PX), (order[is_large], 2 * _MOVING_PX)):
        _splat(canvas, pixels[rows].astype(np.int64), colors[rows].astype(np.uint8), size)
    image = Image.fromarray(canvas).resize((_HEIGHT_PX, _HEIGHT_PX), Image.Resampling.BOX)
    middle = _HEIGHT_PX / 2
    arrow = [(middle + across, middle + ahead) for across, ahead in _ARROW_PX]
    ImageDraw.Draw(image).polygon(arrow, fill=_INK)
    return image


def _projected(points: Floats) -> tuple[Floats, Floats]:
    """Returns pixels (N, 2) of points (N, 3), and their depths (N,) in metres."""
    pitch = math.radians(_PITCH_DEG)
    x, y, z = (points - _CAMERA).T
    depth = x * math.cos(pitch) - z * math.sin(pitch)
    up = x * math.sin(pitch) + z * math.cos(pitch)
    safe = np.maximum(depth, _NEAREST_M)
    columns = _SCALE * _WIDTH_PX / 2 - _FOCAL_PX * y / safe
    rows = _SCALE * _HEIGHT_PX / 2 - _FOCAL_PX * up / safe
    return np.column_stack([columns, rows]), depth


def _points(xyz: Floats32, velocity: Floats32, full_speed_m_s: float) -> NDArray[np.uint8]:
    """Returns the image (H, W, 3) of the points, the nearest on top, moving ones over all."""
    canvas = np.empty((_SCALE * _HEIGHT_PX, _SCALE * _WIDTH_PX, 3), np.uint8)
    canvas[:] = _BACKGROUND
    pixels, depth = _projected(xyz.astype(np.float64))
    packed = packed_colors(velocity, full_speed_m_s)
    colors = np.column_stack([packed >> 16, packed >> 8 & 0xFF, packed & 0xFF]).astype(np.float64)
    moving = np.hypot(velocity[:, 0], velocity[:, 1]) > 0
    # Static points fade into the distance, and are lighter above the ground.
    light = np.clip(1.0 + 0.16 * xyz[:, 2], 0.55, 1.4) * np.clip(1.4 - depth / 80, 0.35, 1.0)
    colors[~moving] *= light[~moving, None]
    visible = (depth > _NEAREST_M) & (depth < _FARTHEST_M)
    for chosen, size in ((visible & ~moving, _STATIC_PX), (visible & moving, _MOVING_PX)):
        rows = np.flatnonzero(chosen)
        rows = rows[np.argsort(-depth[rows], kind="stable")]
        _splat(canvas, pixels[rows].astype(np.int64), colors[rows].astype(np.uint8), size)
    return canvas


def _splat(canvas: NDArray[np.uint8], pixels: Ints, colors: NDArray[np.uint8], size: int) -> None:
    """Sets squares of pixels; later ones cover earlier ones."""
    height, width, _ = canvas.shape
    for right in range(size):
        for down in range(size):
            columns, rows = pixels[:, 0] + right, pixels[:, 1] + down
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
            canvas[rows[inside], columns[inside]] = colors[inside]


def _draw_sensor(canvas: ImageDraw.ImageDraw) -> None:
    arrow = np.array([[2.2, 0.0], [-1.6, 1.1], [-0.7, 0.0], [-1.6, -1.1]])
    pixels, _ = _projected(np.column_stack([arrow, np.full(4, _GROUND_M)]))
    canvas.polygon([tuple(pixel) for pixel in pixels.tolist()], fill=_INK)


def _draw_legend(image: Image.Image, full_speed_m_s: float) -> None:
    """Draws the wheel of colours, ahead is up."""
    rgba = np.rot90(np.rint(255 * wheel_image(_WHEEL_PX * _SCALE))).astype(np.uint8)
    wheel = Image.fromarray(rgba, "RGBA").resize((_WHEEL_PX, _WHEEL_PX), Image.Resampling.BOX)
    x, y = _WIDTH_PX - _WHEEL_PX - 28, _HEIGHT_PX - _WHEEL_PX - 26
    image.paste(wheel, (x, y), wheel)
    canvas, middle = ImageDraw.Draw(image), x + _WHEEL_PX / 2
    font = ImageFont.truetype(str(Path(mpl.get_data_path(), "fonts/ttf/DejaVuSans.ttf")), 10)
    canvas.text((middle, y - 3), "ahead", font=font, fill=_FAINT, anchor="mb")
    below = f"full colour {full_speed_m_s:g} m/s"
    canvas.text((middle, _HEIGHT_PX - 8), below, font=font, fill=_FAINT, anchor="mb")


def animation(frames: Sequence[bytes], interval_s: float) -> bytes:
    """Combines PNG files into an animated WebP with an interval between frames."""
    first, *others = (Image.open(io.BytesIO(one)) for one in frames)
    content = io.BytesIO()
    duration = max(1, round(1e3 * interval_s))
    first.save(
        content, "WEBP", save_all=True, append_images=others, duration=duration, loop=0, quality=60
    )
    return content.getvalue()
