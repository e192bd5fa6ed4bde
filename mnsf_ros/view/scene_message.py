# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One sweep as the page draws it: points with colours, boxes, and paths over ground."""

import json
import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats, Floats32
from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.drawing.color_wheel import (
    FULL_COLOR_M_S,
    FULL_ERROR_M,
    error_colors_rgb,
    packed_colors,
)
from mnsf_ros.sweeps.sweep import NANOSECONDS

Colors = NDArray[np.uint32]

# Of a track, and of the sensor, whose path has a place for each of these steps.
_TRACK_PLACES: Final = 50
_EGO_PLACES: Final = 400
_EGO_STEP_M: Final = 0.5
# Marks a colour as that of a point to be drawn large.
_LARGE: Final = np.uint32(1 << 24)
_LENGTH: Final = struct.Struct("<I")
_ALIGNMENT: Final = 4
_NO_TRUTH: Final = np.uint32(0x1B1E25)


@dataclass(frozen=True, eq=False)
class DrawnSweep:
    """One sweep to be drawn.

    Attributes:
        stamp_ns: Its time in nanoseconds.
        xyz: (N, 3) float32, metres, sensor frame.
        colors: (N,) colours of the points, see `motion_colors`.
        world_from_sensor: (4, 4) float64; the identity if unknown.
        objects: Dynamic objects, sensor frame.
    """

    stamp_ns: int
    xyz: Floats32
    colors: Colors
    world_from_sensor: Floats
    objects: Sequence[TrackedObject]


def motion_colors(velocity: Floats32, is_large: Bools) -> Colors:
    """Returns colours by direction and speed: 0x00RRGGBB, and bit 24 for large points.

    Args:
        velocity: (N, 3) metres per second over ground.
        is_large: (N,) points to be drawn large.
    """
    return packed_colors(velocity, FULL_COLOR_M_S) | is_large * _LARGE


def error_colors(errors_m: Floats32, known: Bools) -> Colors:
    """Returns colours of errors (N,) in metres, dark where none is known."""
    colors = error_colors_rgb(errors_m).astype(np.uint32) @ np.array([2**16, 2**8, 1], np.uint32)
    is_large = errors_m > FULL_ERROR_M / 2
    return np.where(known, colors | is_large * _LARGE, _NO_TRUTH).astype(np.uint32)


@dataclass(frozen=True)
class Trails:
    """Earlier places over ground, oldest first, metres.

    Attributes:
        ego: Those of the sensor.
        objects: `track_id` to those of an object, on the ground.
    """

    ego: list[list[float]]
    objects: dict[int, list[list[float]]]


class Paths:
    """Collects the places of the sensor and of objects; they end where time goes back."""

    def __init__(self) -> None:
        self._last_ns = 0
        self._ego: deque[list[float]] = deque(maxlen=_EGO_PLACES)
        self._tracks: dict[int, deque[list[float]]] = {}

    def after(
        self, stamp_ns: int, world_from_sensor: Floats, objects: Sequence[TrackedObject]
    ) -> Trails:
        """Adds the places of a sweep; returns those up to it."""
        if stamp_ns <= self._last_ns:
            self._ego.clear()
            self._tracks.clear()
        self._last_ns = stamp_ns
        place = world_from_sensor[:3, 3].round(2).tolist()
        if not self._ego or np.hypot(*np.subtract(place, self._ego[-1])[:2]) > _EGO_STEP_M:
            self._ego.append(place)
        before, self._tracks = self._tracks, {}
        for item in objects:
            path = before.get(item.track_id, deque(maxlen=_TRACK_PLACES))
            ground = item.center - [0.0, 0.0, item.size[2] / 2]
            path.append((world_from_sensor @ [*ground, 1.0])[:3].round(2).tolist())
            self._tracks[item.track_id] = path
        tracks = {number: list(path) for number, path in self._tracks.items()}
        return Trails([*self._ego, place], tracks)


def scene_message(scene: DrawnSweep, trails: Trails) -> bytes:
    """Returns a scene for the page.

    The length of a text in JSON, the text, the points as 3 N float32, and N uint32 of colours.
    All numbers are little-endian.
    """
    text = json.dumps(
        {
            "stamp": f"{scene.stamp_ns / NANOSECONDS:.3f}",
            "numPoints": len(scene.xyz),
            "pose": scene.world_from_sensor.ravel().tolist(),
            "ego": trails.ego,
            "objects": [
                _object(item) | {"path": trails.objects.get(item.track_id, [])}
                for item in scene.objects
            ],
        }
    ).encode()
    text += b" " * (-len(text) % _ALIGNMENT)
    xyz = scene.xyz.astype("<f4", copy=False).tobytes()
    return b"".join((_LENGTH.pack(len(text)), text, xyz, scene.colors.astype("<u4").tobytes()))


def _object(item: TrackedObject) -> dict[str, Any]:
    color = int(packed_colors(item.velocity[None].astype(np.float32), FULL_COLOR_M_S)[0])
    return {
        "id": item.track_id,
        "center": item.center.round(3).tolist(),
        "size": item.size.round(2).tolist(),
        "yaw": round(item.yaw, 4),
        "speed": round(float(np.hypot(*item.velocity[:2])), 2),
        "course": round(float(np.arctan2(item.velocity[1], item.velocity[0])), 4),
        "age": round(item.age_s, 1),
        "points": item.num_points,
        "color": f"#{color:06x}",
    }
