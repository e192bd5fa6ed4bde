# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The ground: a gently winding street, side streets, lanes, and its intersections with rays.

World frame: z = 0 is the asphalt, the street runs roughly along +x, traffic keeps to the right.
`lateral` is the distance to the left of the center line in metres.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import AnyFloats, Bools, Floats32
from mnsf_ros.geometry.transforms import apply, invert, planar_pose
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.routes import LEVEL, Route, Slope

LANE_LATERAL_M = 2.0
CURB_HEIGHT_M = 0.14
_SIDE_ROAD_HALF_WIDTH_M = 4.0
_ROUTE_STEP_M = 0.5
_BISECTIONS = 14
# Intensities, and their standard deviation.
_ASPHALT, _SIDEWALK = 22.0, 48.0
_SPECKLE = 5.0
# The face of a curb without its edges, and how far beside the street it may seem to be.
_CURB_EDGE_M = 1e-3
_LANE_MARGIN_M = 0.3


@dataclass(frozen=True)
class Centerline:
    """The middle of the street: y = amplitude * sin(2 pi x / wavelength + phase)."""

    amplitude_m: float
    wavelength_m: float
    phase: float

    @property
    def _wave_number(self) -> float:
        return 2 * math.pi / self.wavelength_m

    def offset(self, x: AnyFloats) -> AnyFloats:
        """Returns y of the center line at x (any shape, metres)."""
        return self.amplitude_m * np.sin(self._wave_number * x + self.phase)

    def heading(self, x: AnyFloats) -> AnyFloats:
        """Returns the direction of the center line at x (any shape, metres) in radians."""
        slope = self.amplitude_m * self._wave_number * np.cos(self._wave_number * x + self.phase)
        return np.arctan(slope)

    def lateral(self, x: AnyFloats, y: AnyFloats) -> AnyFloats:
        """Returns how far (x, y) lies to the left of the center line, good to a few centimeters."""
        return (y - self.offset(x)) * np.cos(self.heading(x))

    def place(self, x: AnyFloats, lateral: AnyFloats | float) -> AnyFloats:
        """Returns (T, 2) points `lateral` (one or (T,), metres) left of the center line at x."""
        heading = self.heading(x)
        left = np.stack([-np.sin(heading), np.cos(heading)], axis=1)
        sideways: AnyFloats = np.reshape(lateral, (-1, 1)) * left
        return np.stack([x, self.offset(x)], axis=1) + sideways

    def crossings(self, x: AnyFloats) -> "tuple[Crossing, ...]":
        """Returns side streets at (T,) x, metres."""
        places = np.stack([x, self.offset(x), self.heading(x)], axis=1)
        return tuple(Crossing(*place) for place in places.tolist())


@dataclass(frozen=True)
class Crossing:
    """A side street that crosses the main street, heading there in radians, at a right angle."""

    x: float
    y: float
    heading: float

    def along(self, x: AnyFloats, y: AnyFloats) -> AnyFloats:
        """Returns how far (x, y) lies from the side street's axis, measured along the main one."""
        return (x - self.x) * math.cos(self.heading) + (y - self.y) * math.sin(self.heading)


@dataclass(frozen=True)
class Street:
    """Center line, extent along x in metres, and crossings from small to large x."""

    centerline: Centerline
    start_x: float
    end_x: float
    crossings: tuple[Crossing, ...]
    half_width_m: float
    slope: Slope = LEVEL

    def lane(self, lateral: float, *, forward: bool) -> Route:
        """Returns the route at a lateral offset, toward +x if `forward`, otherwise toward -x."""
        x = np.arange(self.start_x, self.end_x + _ROUTE_STEP_M, _ROUTE_STEP_M)
        points = self.centerline.place(x, lateral)
        return Route.through(points if forward else points[::-1], self.slope)

    def route(self, x: AnyFloats, lateral: AnyFloats) -> Route:
        """Returns the route through (T,) world x at (T,) laterals, both in metres."""
        return Route.through(self.centerline.place(x, lateral), self.slope)

    def pose(self, x: float, lateral: float, turn: float = 0.0) -> AnyFloats:
        """Returns the (4, 4) pose at x and lateral (metres), turned by `turn` from the street."""
        at = np.array([x])
        place = self.centerline.place(at, lateral)[0]
        heading = float(self.centerline.heading(at)[0])
        return self.slope.lifted(planar_pose(place[0], place[1], heading + turn))

    def is_raised(self, x: AnyFloats, y: AnyFloats) -> Bools:
        """Mask of the (x, y) of any shape that are on the sidewalk, not on asphalt."""
        raised = np.abs(self.centerline.lateral(x, y)) > self.half_width_m
        for crossing in self.crossings:
            raised &= np.abs(crossing.along(x, y)) > _SIDE_ROAD_HALF_WIDTH_M
        return raised

    def clear_of_crossings(self, x: float, margin_m: float) -> bool:
        """True if x is at least `margin_m` away from the axis of every side street."""
        return all(abs(x - crossing.x) >= margin_m for crossing in self.crossings)


def ground_hits(
    street: Street, origin: AnyFloats, directions: AnyFloats, max_range_m: float
) -> tuple[AnyFloats, NDArray[np.uint8]]:
    """Returns (N,) ranges to the ground, `inf` for misses, and (N,) surface classes, 0 there.

    The rays start at (3,) world metres, above the sidewalks, in (N, 3) unit directions; those
    longer than `max_range_m` are misses.
    """
    ranges, classes = _plane_hits(street, origin, directions, max_range_m, is_climb=False)
    if street.slope.grade:
        climb_from_world = invert(street.slope.world_from_climb)
        start, rays = apply(climb_from_world, origin), directions @ climb_from_world[:3, :3].T
        climb, its_classes = _plane_hits(street, start, rays, max_range_m, is_climb=True)
        nearer = climb < ranges
        ranges[nearer], classes[nearer] = climb[nearer], its_classes[nearer]
    return ranges, classes


def _plane_hits(
    street: Street, origin: AnyFloats, directions: AnyFloats, max_range_m: float, *, is_climb: bool
) -> tuple[AnyFloats, NDArray[np.uint8]]:
    """Returns the hits of one of the two planes of the ground, as `ground_hits`, in its frame."""
    ranges = np.full(len(directions), np.inf)
    classes = np.zeros(len(directions), dtype=np.uint8)
    above_m = origin[2] - CURB_HEIGHT_M
    if above_m <= 0.0:
        return ranges, classes
    down = np.flatnonzero(directions[:, 2] < -above_m / max_range_m)
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
    is_beyond = origin[0] + found * rays[:, 0] >= street.slope.start_x
    met = (found <= max_range_m) & (is_beyond == is_climb)
    ranges[down] = np.where(met, found, np.inf)
    classes[down] = np.where(sidewalk, SurfaceClass.SIDEWALK, SurfaceClass.ROAD)
    classes[~np.isfinite(ranges)] = 0
    return ranges, classes


def _raised(street: Street, origin: AnyFloats, directions: AnyFloats, ranges: AnyFloats) -> Bools:
    x = origin[0] + ranges * directions[:, 0]
    y = origin[1] + ranges * directions[:, 1]
    return street.is_raised(x, y)


def _curb_ranges(
    street: Street, origin: AnyFloats, directions: AnyFloats, before: AnyFloats, behind: AnyFloats
) -> AnyFloats:
    """Returns the ranges at which rays meet the curb, between asphalt and sidewalk."""
    for _ in range(_BISECTIONS):
        middle = (before + behind) / 2
        raised = _raised(street, origin, directions, middle)
        before, behind = np.where(raised, before, middle), np.where(raised, middle, behind)
    return behind


def ground_cosines(street: Street, points: AnyFloats, directions: AnyFloats) -> AnyFloats:
    """Returns (N,) cosines of the incidence of unit directions at points on the ground, (N, 3)."""
    cosines = np.abs(directions[:, 2])
    is_curb = (points[:, 2] > _CURB_EDGE_M) & (points[:, 2] < CURB_HEIGHT_M - _CURB_EDGE_M)
    x, y = points[is_curb, :2].T
    heading = street.centerline.heading(x)
    beside_m = np.abs(street.centerline.lateral(x, y))
    # The curbs of side streets face along the main one.
    facing = heading + np.where(beside_m < street.half_width_m + _LANE_MARGIN_M, math.pi / 2, 0.0)
    along, across = directions[is_curb, :2].T
    cosines[is_curb] = np.abs(np.cos(facing) * along + np.sin(facing) * across)
    return cosines


def brightness(class_id: NDArray[np.uint8], reflectivity: AnyFloats) -> AnyFloats:
    """Returns (N,) mean intensities of points of some classes (N,).

    The reflectivity (N,) is of the body of each point, ignored on the ground.
    """
    mean = reflectivity.copy()
    mean[class_id == SurfaceClass.ROAD] = _ASPHALT
    mean[class_id == SurfaceClass.SIDEWALK] = _SIDEWALK
    return mean


def intensities(mean: AnyFloats, rng: np.random.Generator) -> Floats32:
    """Returns (N,) intensities from 0 to 255 of mean intensities, with speckle."""
    speckled = mean + rng.normal(0.0, _SPECKLE, len(mean))
    return np.clip(speckled, 0.0, 255.0).astype(np.float32)
