# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Mounting of a lidar: the motion from its frame to a level one whose origin is the lens."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.geometry.transforms import invert

# Finer than any mount; so a level frame stays exactly as it is.
_SNAP: Final = 1e-6


@dataclass(frozen=True, eq=False)
class Mounting:
    """How a lidar is mounted.

    Two sweeps are of one mounting if theirs is the same object.

    Attributes:
        level_from_sensor: (4, 4) float64, rigid, to a frame with z up whose origin is the lens.
        source: Where it is known from, in words.
    """

    level_from_sensor: Floats
    source: str

    @classmethod
    def of(cls, up: Floats, lens_m: Floats, source: str) -> "Mounting":
        """Returns the mounting by the axis that points up and the place of the lens.

        Both are (3,), in the frame of the cloud. Forward stays forward: the x axis, or y where x
        points up or down.
        """
        up = up / np.linalg.norm(up)
        forward = np.eye(3)[1 if abs(up[0]) > np.cos(np.radians(10.0)) else 0]
        forward = forward - (forward @ up) * up
        forward /= np.linalg.norm(forward)
        level = np.eye(4)
        level[:3, :3] = forward, np.cross(up, forward), up
        if np.abs(level - np.eye(4)).max() < _SNAP:
            level = np.eye(4)
        level[:3, 3] = -level[:3, :3] @ lens_m
        return cls(level, source)

    @cached_property
    def is_level(self) -> bool:
        """Whether the frame of the sensor is level already."""
        return bool(np.array_equal(self.level_from_sensor, np.eye(4)))

    @property
    def sensor_from_level(self) -> Floats:
        """(4, 4), the other way round."""
        return np.asarray(invert(self.level_from_sensor), np.float64)

    @property
    def tilt_deg(self) -> float:
        """Angle between z of the sensor and up."""
        return tilt_deg(self.level_from_sensor[2, :3])

    @property
    def lens_m(self) -> Floats:
        """(3,) place of the lens in the frame of the sensor."""
        return self.sensor_from_level[:3, 3]

    @property
    def place(self) -> str:
        """The place of the lens, in words."""
        return f"{', '.join(f'{value:.2f}' for value in np.round(self.lens_m, 2) + 0.0)} m"

    def __str__(self) -> str:
        """Tilt, place of the lens if it is not the origin, and source."""
        tilt = f"tilted by {self.tilt_deg:.0f} degrees" if self.tilt_deg > 0 else "upright"
        if self.lens_m.any():
            tilt += f", lens at {self.place}"
        return f"{tilt} ({self.source})"


def tilt_deg(up: Floats) -> float:
    """Returns the angle in degrees between z and a unit vector (3,); more numbers do not count."""
    return float(np.degrees(np.arccos(np.clip(up[2], -1.0, 1.0))))
