# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of sweeps in perspective: moving points coloured, with boxes and speeds."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import matplotlib as mpl
import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from mnsf_ros.drawing.color_wheel import packed_colors, wheel_image

WIDTH_PX: Final = 880
HEIGHT_PX: Final = 470
# Of a picture beside another one.
_SIDE_WIDTH_PX, _SIDE_HEIGHT_PX = 560, 299
_GAP_PX: Final = 4
_GAP_COLOR: Final = (90, 98, 110)
_SCALE: Final = 2  # drawn larger, for smooth edges
_BACKGROUND: Final = np.array([13, 15, 20], np.uint8)
_INK: Final = (225, 228, 232)
_FAINT: Final = (140, 147, 156)
# The camera is behind and above the sensor and looks ahead and down.
_CAMERA: Final = np.array([-17.0, 0.0, 17.0])
_PITCH_DEG: Final = 35.0
_FOCAL_PX: Final = 620.0 * _SCALE
_NEAREST_M: Final = 2.0
_FARTHEST_M: Final = 120.0
_GROUND_M: Final = -1.8  # about so far below the lidar of a car
_STATIC_PX: Final = 2
_MOVING_PX: Final = 4
_WHEEL_PX: Final = 74
_EDGES: Final = ((0, 1), (1, 3), (3, 2), (2, 0), (4, 5), (5, 7), (7, 6), (6, 4))
_PILLARS: Final = ((0, 4), (1, 5), (2, 6), (3, 7))


# Left, top, right and bottom, pixels.
_Box = tuple[float, float, float, float]


@dataclass(frozen=True, eq=False)
class ShownObject:
    """A box with its velocity.

    Attributes:
        center: (3,) metres, sensor frame.
        size: (3,) metres: length along `yaw`, width, height.
        yaw: Radians about z.
        velocity: (3,) metres per second over ground.
        way: (K, 3) metres, earlier places of its middle, oldest first.
    """

    center: NDArray[np.float64]
    size: NDArray[np.float64]
    yaw: float
    velocity: NDArray[np.float64]
    way: NDArray[np.float32]


def street_picture(
    xyz: NDArray[np.float32],
    velocity: NDArray[np.float32],
    objects: Sequence[ShownObject],
    full_speed_m_s: float,
) -> Image.Image:
    """Draws a sweep, 880 x 470 pixels.

    Args:
        xyz: (N, 3) metres, sensor frame, x forward.
        velocity: (N, 3) metres per second over ground; static points are grey.
        objects: Moving objects.
        full_speed_m_s: Speed of the full colour.
    """
    image = Image.fromarray(_points(xyz, velocity, full_speed_m_s))
    canvas = ImageDraw.Draw(image, "RGBA")
    _draw_sensor(canvas)
    labels: list[_Box] = []
    # The labels of the nearest are kept where several would overlap.
    for item in sorted(objects, key=lambda item: float(np.hypot(item.center[0], item.center[1]))):
        _draw_object(canvas, item, full_speed_m_s, labels)
    image = image.resize((WIDTH_PX, HEIGHT_PX), Image.Resampling.BOX)
    _draw_legend(image, full_speed_m_s)
    return image


def _projected(points: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns pixels (N, 2) of points (N, 3), and their depths (N,) in metres."""
    pitch = math.radians(_PITCH_DEG)
    x, y, z = (points - _CAMERA).T
    depth = x * math.cos(pitch) - z * math.sin(pitch)
    up = x * math.sin(pitch) + z * math.cos(pitch)
    safe = np.maximum(depth, _NEAREST_M)
    columns = _SCALE * WIDTH_PX / 2 - _FOCAL_PX * y / safe
    rows = _SCALE * HEIGHT_PX / 2 - _FOCAL_PX * up / safe
    return np.column_stack([columns, rows]), depth


def _points(
    xyz: NDArray[np.float32], velocity: NDArray[np.float32], full_speed_m_s: float
) -> NDArray[np.uint8]:
    """Returns the image (H, W, 3) of the points, the nearest on top, moving ones over all."""
    canvas = np.empty((_SCALE * HEIGHT_PX, _SCALE * WIDTH_PX, 3), np.uint8)
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


def _splat(
    canvas: NDArray[np.uint8], pixels: NDArray[np.int64], colors: NDArray[np.uint8], size: int
) -> None:
    """Sets squares of pixels; later ones cover earlier ones."""
    height, width, _ = canvas.shape
    for right in range(size):
        for down in range(size):
            columns, rows = pixels[:, 0] + right, pixels[:, 1] + down
            inside = (columns >= 0) & (columns < width) & (rows >= 0) & (rows < height)
            canvas[rows[inside], columns[inside]] = colors[inside]


def _draw_object(
    canvas: ImageDraw.ImageDraw, item: ShownObject, full_speed_m_s: float, labels: list[_Box]
) -> None:
    pixels, depth = _projected(_corners(item))
    if (depth < _NEAREST_M).any():
        return
    color = _color(item.velocity, full_speed_m_s)
    points = [tuple(pixel) for pixel in pixels.tolist()]
    for first, second in (*_EDGES, *_PILLARS):
        canvas.line([points[first], points[second]], fill=(*color, 210), width=_SCALE)
    _draw_way(canvas, item, color)
    _draw_label(canvas, pixels, item, labels)


def _draw_label(
    canvas: ImageDraw.ImageDraw, pixels: NDArray[np.float64], item: ShownObject, labels: list[_Box]
) -> None:
    """Draws the speed above or below the box of an object, where it is whole and covers no other.

    `pixels` (8, 2) are the corners of the box.
    """
    speed = float(np.hypot(item.velocity[0], item.velocity[1]))
    text, font = f"{speed:.1f} m/s", _font(12 * _SCALE)
    (left, top), (right, bottom) = pixels.min(axis=0).tolist(), pixels.max(axis=0).tolist()
    middle, gap = (left + right) / 2, 4 * _SCALE
    for place, anchor in (((middle, top - gap), "mb"), ((middle, bottom + gap), "mt")):
        label = canvas.textbbox(place, text, font=font, anchor=anchor, stroke_width=_SCALE)
        if _is_inside(label) and not any(_overlap(label, other) for other in labels):
            labels.append(label)
            outline = tuple(_BACKGROUND.tolist())
            canvas.text(place, text, _INK, font, anchor, stroke_width=_SCALE, stroke_fill=outline)
            return


def _is_inside(box: _Box) -> bool:
    inside_columns = box[0] >= 0 and box[2] <= _SCALE * WIDTH_PX
    return inside_columns and box[1] >= 0 and box[3] <= _SCALE * HEIGHT_PX


def _overlap(first: _Box, second: _Box) -> bool:
    columns = first[0] < second[2] and second[0] < first[2]
    return columns and first[1] < second[3] and second[1] < first[3]


def _draw_sensor(canvas: ImageDraw.ImageDraw) -> None:
    arrow = np.array([[2.2, 0.0], [-1.6, 1.1], [-0.7, 0.0], [-1.6, -1.1]])
    pixels, _ = _projected(np.column_stack([arrow, np.full(4, _GROUND_M)]))
    canvas.polygon([tuple(pixel) for pixel in pixels.tolist()], fill=_INK)


def _draw_way(canvas: ImageDraw.ImageDraw, item: ShownObject, color: tuple[int, int, int]) -> None:
    base = np.array([0.0, 0.0, -item.size[2] / 2])
    pixels, depth = _projected(np.vstack([item.way, item.center]) + base)
    for index in range(len(pixels) - 1):
        if (depth[index : index + 2] > _NEAREST_M).all():
            fade = round(200 * (index + 1) / len(pixels))
            ends = [tuple(pixel) for pixel in pixels[index : index + 2].tolist()]
            canvas.line(ends, fill=(*color, fade), width=2 * _SCALE)


def _corners(item: ShownObject) -> NDArray[np.float64]:
    """Returns (8, 3) corners: front before back, left before right; the lower four first."""
    signs = np.array([[x, y, z] for z in (-1, 1) for x in (1, -1) for y in (1, -1)], float)
    local = signs * item.size / 2
    cos, sin = math.cos(item.yaw), math.sin(item.yaw)
    turned = local @ np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    return np.asarray(turned + item.center, np.float64)


def _color(velocity: NDArray[np.float64], full_speed_m_s: float) -> tuple[int, int, int]:
    packed = int(packed_colors(velocity[None].astype(np.float32), full_speed_m_s)[0])
    return packed >> 16, packed >> 8 & 0xFF, packed & 0xFF


def _draw_legend(image: Image.Image, full_speed_m_s: float) -> None:
    """Draws the wheel of colours, ahead is up."""
    rgba = np.rot90(np.rint(255 * wheel_image(_WHEEL_PX * _SCALE))).astype(np.uint8)
    wheel = Image.fromarray(rgba, "RGBA").resize((_WHEEL_PX, _WHEEL_PX), Image.Resampling.BOX)
    x, y = WIDTH_PX - _WHEEL_PX - 22, HEIGHT_PX - _WHEEL_PX - 34
    image.paste(wheel, (x, y), wheel)
    canvas = ImageDraw.Draw(image)
    middle = x + _WHEEL_PX / 2
    canvas.text((middle, y - 4), "ahead", font=_font(12), fill=_FAINT, anchor="mb")
    below = f"full colour {full_speed_m_s:g} m/s"
    canvas.text((middle, HEIGHT_PX - 12), below, font=_font(12), fill=_FAINT, anchor="mb")


def _font(size_px: int) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(Path(mpl.get_data_path(), "fonts/ttf/DejaVuSans.ttf")), size_px)


def frame(
    xyz: NDArray[np.float32], velocities: Sequence[NDArray[np.float32]], full_speed_m_s: float
) -> bytes:
    """Returns a PNG file with a picture for each of the velocities, see `street_picture`."""
    width = len(velocities) * (_SIDE_WIDTH_PX + _GAP_PX) - _GAP_PX
    whole = Image.new("RGB", (width, _SIDE_HEIGHT_PX), _GAP_COLOR)
    for place, velocity in enumerate(velocities):
        picture = street_picture(xyz, velocity, [], full_speed_m_s)
        picture = picture.resize((_SIDE_WIDTH_PX, _SIDE_HEIGHT_PX), Image.Resampling.BOX)
        whole.paste(picture, (place * (_SIDE_WIDTH_PX + _GAP_PX), 0))
    content = io.BytesIO()
    whole.save(content, "PNG")
    return content.getvalue()


def animation(frames: Sequence[bytes], interval_s: float) -> bytes:
    """Returns a WebP file of PNG files that plays at an interval."""
    first, *others = (Image.open(io.BytesIO(one)) for one in frames)
    content = io.BytesIO()
    duration = max(1, round(1e3 * interval_s))
    first.save(
        content, "WEBP", save_all=True, append_images=others, duration=duration, loop=0, quality=60
    )
    return content.getvalue()
