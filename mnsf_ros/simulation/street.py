# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The ground plan: a gently winding street, the side streets that cross it, and their lanes.

World frame: z = 0 is the asphalt, the street runs roughly along +x, traffic keeps to the right.
`lateral` is the distance to the left of the center line in metres.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mnsf_ros.geometry.transforms import FloatArray, planar_pose
from mnsf_ros.simulation.routes import Route

if TYPE_CHECKING:
    from numpy.typing import NDArray

ROAD_HALF_WIDTH_M = 6.5
LANE_LATERAL_M = 2.0
BICYCLE_LATERAL_M = 3.75
PARKING_LATERAL_M = 5.4
FURNITURE_LATERAL_M = 7.3
FACADE_LATERAL_M = 11.0
CURB_HEIGHT_M = 0.14
SIDE_ROAD_HALF_WIDTH_M = 4.0
SIDE_FACADE_M = 7.0
SIDE_STREET_LENGTH_M = 60.0
_ROUTE_STEP_M = 0.5


@dataclass(frozen=True)
class Centerline:
    """The middle of the street: y = amplitude * sin(2 pi x / wavelength + phase)."""

    amplitude_m: float
    wavelength_m: float
    phase: float

    @property
    def _wave_number(self) -> float:
        return 2 * math.pi / self.wavelength_m

    def offset(self, x: FloatArray) -> FloatArray:
        """Returns y of the center line at x (any shape, metres)."""
        offset: FloatArray = self.amplitude_m * np.sin(self._wave_number * x + self.phase)
        return offset

    def heading(self, x: FloatArray) -> FloatArray:
        """Returns the direction of the center line at x (any shape, metres) in radians."""
        slope = self.amplitude_m * self._wave_number * np.cos(self._wave_number * x + self.phase)
        heading: FloatArray = np.arctan(slope)
        return heading

    def lateral(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Returns how far (x, y) lies to the left of the center line, good to a few centimeters."""
        lateral: FloatArray = (y - self.offset(x)) * np.cos(self.heading(x))
        return lateral

    def place(self, x: FloatArray, lateral: FloatArray | float) -> FloatArray:
        """Returns (T, 2) points `lateral` (one or (T,), metres) left of the center line at x."""
        heading = self.heading(x)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        sideways: FloatArray = np.reshape(lateral, (-1, 1)) * left
        return np.stack([x, self.offset(x)], axis=1) + sideways


@dataclass(frozen=True)
class Crossing:
    """A side street that crosses the main street, heading there in radians, at a right angle."""

    x: float
    y: float
    heading: float

    def along(self, x: FloatArray, y: FloatArray) -> FloatArray:
        """Returns how far (x, y) lies from the side street's axis, measured along the main one."""
        return (x - self.x) * math.cos(self.heading) + (y - self.y) * math.sin(self.heading)


@dataclass(frozen=True)
class Street:
    """Center line, extent along x in metres, and crossings from small to large x."""

    centerline: Centerline
    start_x: float
    end_x: float
    crossings: tuple[Crossing, ...]
    half_width_m: float = ROAD_HALF_WIDTH_M

    def lane(self, lateral: float, *, forward: bool) -> Route:
        """Returns the route at a lateral offset, toward +x if `forward`, otherwise toward -x."""
        x = np.arange(self.start_x, self.end_x + _ROUTE_STEP_M, _ROUTE_STEP_M)
        points = self.centerline.place(x, lateral)
        return Route.through(points if forward else points[::-1])

    def route(self, x: FloatArray, lateral: FloatArray) -> Route:
        """Returns the route through (T,) world x at (T,) laterals, both in metres."""
        return Route.through(self.centerline.place(x, lateral))

    def pose(self, x: float, lateral: float, turn: float = 0.0) -> FloatArray:
        """Returns the (4, 4) pose at x and lateral (metres), turned by `turn` from the street."""
        at = np.array([x])
        place = self.centerline.place(at, lateral)[0]
        return planar_pose(place[0], place[1], float(self.centerline.heading(at)[0]) + turn)

    def is_raised(self, x: FloatArray, y: FloatArray) -> NDArray[np.bool_]:
        """Mask of the (x, y) of any shape that are on the sidewalk, not on asphalt."""
        raised = np.abs(self.centerline.lateral(x, y)) > self.half_width_m
        for crossing in self.crossings:
            raised &= np.abs(crossing.along(x, y)) > SIDE_ROAD_HALF_WIDTH_M
        return raised

    def clear_of_crossings(self, x: float, margin_m: float) -> bool:
        """True if x is at least `margin_m` away from the axis of every side street."""
        return all(abs(x - crossing.x) >= margin_m for crossing in self.crossings)
