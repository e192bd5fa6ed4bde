# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Routes of moving things, speeds along them, and clearance between them."""

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from mnsf_ros.arrays import AnyFloats
from mnsf_ros.geometry.transforms import planar_pose, tilt

EGO_LENGTH_M = 4.4
EGO_WIDTH_M = 1.8
_WATCH_STEP_S = 0.1
# Length over which the ground turns from level to slope.
_VERTEX_M = 8.0


@dataclass(frozen=True)
class Slope:
    """Ground that is level up to `start_x` and climbs by `grade` from there on along +x."""

    start_x: float = math.inf
    grade: float = 0.0

    @property
    def world_from_climb(self) -> AnyFloats:
        """(4, 4) frame of the climbing ground: z = 0 is the ground, x > 0 the climb."""
        pose = planar_pose(self.start_x, 0.0, 0.0) @ tilt(-math.atan(self.grade), 0.0)
        return pose @ planar_pose(-self.start_x, 0.0, 0.0)

    def lifted(self, pose: AnyFloats) -> AnyFloats:
        """Returns a pose (4, 4) on level ground as it is on this ground; it turns gradually."""
        share = (float(pose[0, 3]) - self.start_x) / _VERTEX_M + 0.5
        if share <= 0.0:
            return pose
        climbed_m = _VERTEX_M * (min(share, 1.0) ** 2 / 2 + max(share - 1.0, 0.0))
        lifted = tilt(-math.atan(self.grade) * min(share, 1.0), 0.0) @ pose
        lifted[:3, 3] = pose[:3, 3] + (0.0, 0.0, self.grade * climbed_m)
        return lifted


LEVEL = Slope()


@dataclass(frozen=True)
class Route:
    """A curve over the ground: closely spaced points (M, 2) in world metres, M at least 2.

    `arc_m` (M,) is the distance along the curve from the first point, `yaw` (M,) the direction of
    travel in radians, without jumps.
    """

    points: AnyFloats
    arc_m: AnyFloats
    yaw: AnyFloats
    slope: Slope = LEVEL

    @classmethod
    def through(cls, points: AnyFloats, slope: Slope = LEVEL) -> "Route":
        """Returns the route that visits the (M, 2) points, given in metres, in order."""
        steps = np.hypot(*np.diff(points, axis=0).T)
        arc_m = np.concatenate([[0.0], np.cumsum(steps)])
        tangent = np.gradient(points, arc_m, axis=0)
        yaw = np.unwrap(np.arctan2(tangent[:, 1], tangent[:, 0]))
        return cls(points, arc_m, yaw, slope)

    @property
    def length_m(self) -> float:
        """Length of the curve in metres."""
        return float(self.arc_m[-1])

    def arc_nearest(self, x: float, y: float) -> float:
        """Returns the arc length in metres of the route point nearest to (x, y)."""
        return float(self.arc_m[np.argmin(np.hypot(*(self.points - (x, y)).T))])

    def beside(self, left_m: float) -> "Route":
        """Returns the route shifted to the left."""
        left = np.stack([-np.sin(self.yaw), np.cos(self.yaw)], axis=1)
        return Route.through(self.points + left_m * left, self.slope)

    def poses(self, arc_m: AnyFloats) -> AnyFloats:
        """Returns (T, 3) x, y and yaw at (T,) arc lengths; routes end in straight lines."""
        inside = np.clip(arc_m, 0.0, self.length_m)
        yaw = np.interp(inside, self.arc_m, self.yaw)
        beyond = arc_m - inside
        x = np.interp(inside, self.arc_m, self.points[:, 0]) + beyond * np.cos(yaw)
        y = np.interp(inside, self.arc_m, self.points[:, 1]) + beyond * np.sin(yaw)
        return np.stack([x, y, yaw], axis=1)


@dataclass(frozen=True, eq=False)
class SpeedProfile:
    """Speed over time: linear between breakpoints, constant before the first and after the last.

    (P,) increasing breakpoints in seconds and the speeds there in m/s.
    """

    times_s: AnyFloats
    speeds_m_s: AnyFloats

    @classmethod
    def steady(cls, speed_m_s: float) -> "SpeedProfile":
        """Returns a profile of constant speed."""
        return cls(np.array([0.0]), np.array([speed_m_s]))

    def distances(self, times_s: AnyFloats) -> AnyFloats:
        """Returns (T,) metres traveled since the first breakpoint, negative before it."""
        speed = self.speeds_m_s
        spans = np.diff(self.times_s)
        marks = np.concatenate([[0.0], np.cumsum(spans * (speed[:-1] + speed[1:]) / 2)])
        index = np.clip(np.searchsorted(self.times_s, times_s, side="right") - 1, 0, None)
        elapsed = times_s - self.times_s[index]
        slope = np.concatenate([np.diff(speed) / spans, [0.0]])
        # Before the first breakpoint nothing accelerates.
        acceleration = np.where(elapsed < 0.0, 0.0, slope[index])
        return marks[index] + elapsed * (speed[index] + acceleration * elapsed / 2)


@dataclass(frozen=True)
class Trip:
    """One thing traveling along a route: at the first breakpoint it is at `start_arc_m`."""

    route: Route
    profile: SpeedProfile
    start_arc_m: float

    @classmethod
    def starting_at(cls, route: Route, profile: SpeedProfile, arc_m: float) -> "Trip":
        """Returns the trip that is at an arc length at time 0."""
        return cls(route, profile, arc_m - float(profile.distances(np.zeros(1))[0]))

    def planar(self, times_s: AnyFloats) -> AnyFloats:
        """Returns (T, 3) world x, y (metres) and yaw (radians) at (T,) times in seconds."""
        traveled = self.profile.distances(times_s)
        return self.route.poses(self.start_arc_m + traveled)

    def pose(self, time_s: float) -> AnyFloats:
        """Returns the (4, 4) pose `world_from_body` at a time in seconds."""
        x, y, yaw = self.planar(np.array([time_s]))[0]
        return self.route.slope.lifted(planar_pose(x, y, yaw))


@dataclass(frozen=True)
class SensorTrip:
    """The trip of the sensor, with its mounting and the sway of the vehicle.

    The rows of `sway` (3, 3) are pitch (rad), roll (rad), heave (m); columns amplitude, Hz, phase.
    `mounting` is (pitch, roll, height) at rest. `swing` to both sides is a yaw in the same columns.
    """

    trip: Trip
    sway: AnyFloats
    mounting: tuple[float, float, float]
    swing: tuple[float, float, float] = (0.0, 0.0, 0.0)

    def world_from_sensor(self, time_s: float) -> AnyFloats:
        """Returns the (4, 4) pose of the lidar frame (x forward, y left, z up) at a time."""
        amplitude, frequency, phase = self.sway.T
        sway = amplitude * np.sin(2 * math.pi * frequency * time_s + phase)
        pitch, roll, height_m = self.mounting + sway
        amplitude_rad, swing_hz, swing_phase = self.swing
        yaw = amplitude_rad * math.sin(2 * math.pi * swing_hz * time_s + swing_phase)
        pose = self.trip.pose(time_s) @ planar_pose(0.0, 0.0, yaw) @ tilt(pitch, roll)
        pose[2, 3] += height_m
        return pose


@dataclass(frozen=True)
class _Track:
    """Discs (T, K, 2) that cover a footprint over time, and their bounding box."""

    centers: AnyFloats
    radius_m: float
    low: AnyFloats
    high: AnyFloats


class Clearance:
    """Keeps moving things apart: a trip is accepted only if it never meets an accepted one."""

    def __init__(self, end_s: float, *, margin_m: float = 0.05) -> None:
        """Watches over times from 0 to `end_s`; each thing keeps `margin_m` around itself."""
        self._times_s = np.arange(0.0, end_s + _WATCH_STEP_S, _WATCH_STEP_S)
        self._margin_m = margin_m
        self._tracks: list[_Track] = []

    def accept(self, *rectangles: tuple[Trip, float, float]) -> bool:
        """Adds trips of rectangles, length and width, that go together; they may touch each other.

        Returns False, and adds none of them, if one meets an accepted trip.
        """
        tracks = [self._track(*rectangle) for rectangle in rectangles]
        if any(_meet(track, other) for track in tracks for other in self._near(track)):
            return False
        self._tracks += tracks
        return True

    def _near(self, track: _Track) -> Iterator[_Track]:
        """Yields the tracks whose bounding box overlaps with the box of a track."""
        low = np.array([other.low for other in self._tracks]).reshape(-1, 2)
        high = np.array([other.high for other in self._tracks]).reshape(-1, 2)
        for number in np.flatnonzero(((low <= track.high) & (track.low <= high)).all(axis=1)):
            yield self._tracks[number]

    def _track(self, trip: Trip, length_m: float, width_m: float) -> _Track:
        count = max(1, math.ceil(length_m / width_m))
        spacing = length_m / count
        radius = math.hypot(spacing, width_m) / 2 + self._margin_m
        offsets = (np.arange(count) + 0.5) * spacing - length_m / 2
        planar = trip.planar(self._times_s)
        ahead = np.stack([np.cos(planar[:, 2]), np.sin(planar[:, 2])], axis=1)
        centers = planar[:, None, :2] + offsets[None, :, None] * ahead[:, None, :]
        low = centers.min(axis=(0, 1)) - radius
        return _Track(centers, radius, low, centers.max(axis=(0, 1)) + radius)


def _meet(one: _Track, other: _Track) -> bool:
    apart = one.centers[:, :, None, :] - other.centers[:, None, :, :]
    nearest = np.min(np.einsum("tijk,tijk->tij", apart, apart))
    return bool(nearest < (one.radius_m + other.radius_m) ** 2)
