# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Registration of a sweep with a map of the sweeps before it."""

from dataclasses import dataclass, field, replace
from itertools import product
from typing import Final

import numpy as np
from scipy.ndimage import maximum_filter
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.compiled import compiled
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.surface_map import Comparison, SurfaceMap
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.geometry.transforms import planar_pose
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, Sweep

# A point this far from its surface counts half. At this width, traffic has little effect: of .04 to
# .15, .05 gives the smallest errors in 336 random worlds, and with .04 registration fails in one.
_NOISE_M: Final = 0.05
# Used instead to find unexpected motions, for example with wrong stamps.
_WIDE_M: Final = 0.1
_MAX_STEPS: Final = 10
# Iteration ends at steps below this share of the noise, at 30 m range.
_LAST_STEP: Final = 0.06
_FAR_M: Final = 30.0
# A place is unknown if points far from the sensor have a larger standard deviation, horizontally.
_MAX_DEVIATION_M: Final = 0.3
# Besides independent errors, all points share a bias of this size, from traffic or the pattern of
# the rays. With .0002, errors in tunnels are larger than their covariance.
_COMMON_M: Final = 0.0003
# Covariance of a velocity that is not estimated: 0, but with an inverse.
KNOWN_VELOCITY: Final = 1e-8 * np.eye(6)
# Of an unconstrained direction.
_LEAST_CURVATURE: Final = 1e-6
# Search range without an expected motion: 5 m a sweep is 180 km/h at 10 Hz, and a robot that turns
# on the spot makes 120 degrees/s. Angles in degrees and shifts in metres are tried with some
# points; the best ones are refined with all.
_TURN_DEG_S: Final = 120.0
_MAX_TURN_DEG: Final = 90.0
_ANGLE_DEG: Final = 2.0
_LONG_SHIFTS_M: Final = np.linspace(-5.0, 5.0, 25)
_SHORT_SHIFTS_M: Final = np.linspace(-1.0, 1.0, 5)
_SEARCH_POINTS: Final = 1000
_SEARCH_STARTS: Final = 5
# Fewer of the points in cells that were seen before are those of another place: .55 and more of the
# second sweep of random worlds but for two of 117, .46 and less of other places (tunnels .62).
_MIN_KNOWN: Final = 0.47
_MIN_POINTS: Final = 50


@dataclass(frozen=True, eq=False)
class Placed:
    """A pose of the sensor and its velocity there, with their covariances.

    Attributes:
        pose: (4, 4) world_from_sensor.
        covariance: (6, 6) in the axes of the world: metres, then radians; by default that
            of a pose that is hardly known.
        velocity: (6,) on top of the motion that points were corrected for, in the same axes and
            units per second.
        velocity_covariance: (6, 6) of it; the expected velocity is 0.
    """

    pose: Floats
    covariance: Floats = field(default_factory=lambda: np.eye(6))
    velocity: Floats = field(default_factory=lambda: np.zeros(6))
    velocity_covariance: Floats = field(default_factory=KNOWN_VELOCITY.copy)

    @property
    def information(self) -> AnyFloats:
        """(3, 3) inverse of the covariance of the position."""
        return np.linalg.inv(self.covariance[:3, :3])


class SweepMatcher:
    """Finds the pose of each sweep in the map of the sweeps before it.

    Attributes:
        last_cloud: The last sweep; None before the first one.
        last_pose: (4, 4) its pose.
    """

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._settings = settings
        self._map = SurfaceMap(settings.map_cell_m, settings.map_sweeps)
        self.last_pose = np.eye(4)
        self.last_cloud: Cloud | None = None

    @property
    def is_empty(self) -> bool:
        """True before the first sweep."""
        return self._map.is_empty

    def prepared(self, sweep: Sweep, motion: SweepMotion | None) -> Cloud | None:
        """Returns a prepared sweep; None if there are too few points near the sensor.

        With a motion, points are corrected for it, as if measured in one moment.
        """
        cloud = Cloud.of(sweep, motion, self._settings)
        return None if len(cloud) < _MIN_POINTS else cloud

    def add(self, cloud: Cloud | None, placed: Placed) -> None:
        """Adds a sweep to the map."""
        if cloud is not None:
            self._map.add(cloud, cloud.poses(placed.pose, placed.velocity))
            self.last_pose, self.last_cloud = placed.pose, cloud

    def match(
        self,
        cloud: Cloud,
        expected: Placed | None,
        elapsed_s: float = USUAL_INTERVAL_S,
    ) -> Placed | None:
        """Returns the pose of a sweep.

        The search starts from the expected pose, which is None if the motion is unknown: then it
        is as wide as the sensor may have turned since the last sweep. The expected pose decides in
        directions that the map hardly constrains. Returns None if the map does not know the place,
        or if both together do not constrain position and heading.
        """
        if self.is_empty:
            return None
        if expected is not None:
            found = _known(cloud, *self._near(cloud, expected))
            if found is not None:
                return found
        return self._searched(cloud, elapsed_s)

    def share_matched(self, cloud: Cloud, expected: Floats) -> float:
        """Returns the share of the points on surfaces, at the best pose near an expected (4, 4)."""
        start = Placed(expected)
        _, there = self._aligned(cloud, start, start)
        return there.support / max(len(cloud), 1)

    def _near(self, cloud: Cloud, expected: Placed) -> tuple[Placed, Comparison]:
        """The likeliest pose near an expected one, with the comparison there."""
        found = self._aligned(cloud, expected, expected)
        wide, _ = self._aligned(cloud, found[0], expected, _WIDE_M)
        change = wide.pose - found[0].pose
        if _distance_m(change[:3, 3], change[:3, :3]) < _WIDE_M:
            return found
        other = self._aligned(cloud, wide, expected)
        return max(found, other, key=lambda each: _posterior(each[0].pose, each[1], expected))

    def _searched(self, cloud: Cloud, elapsed_s: float) -> Placed | None:
        """The pose near the last one, None if the map does not know the place."""
        starts = [Placed(start) for start in self._starts(cloud, elapsed_s)]
        wide = [self._aligned(cloud, start, start, _WIDE_M)[0] for start in starts]
        settled = [self._aligned(cloud, each, each) for each in wide]
        return _known(cloud, *max(settled, key=lambda found: _likelihood(found[1])))

    def _starts(self, cloud: Cloud, elapsed_s: float) -> list[Floats]:
        """The last pose, and the most promising of many around it."""
        stride = max(1, cloud.num_standing // _SEARCH_POINTS)
        some = cloud.at_once(np.ascontiguousarray(cloud.upper.points[::stride]))
        starts = [self.last_pose]
        turn_deg = min(max(elapsed_s, USUAL_INTERVAL_S) * _TURN_DEG_S, _MAX_TURN_DEG)
        turns_deg = np.linspace(-turn_deg, turn_deg, 2 * round(turn_deg / _ANGLE_DEG) + 1)
        for angles_deg, shifts_m in ((np.zeros(1), _LONG_SHIFTS_M), (turns_deg, _SHORT_SHIFTS_M)):
            places = [
                self.last_pose @ planar_pose(x, y, np.radians(angle))
                for angle, x, y in product(angles_deg, shifts_m, shifts_m)
            ]
            there = [self._map.compared(some, pose[None], _WIDE_M) for pose in places]
            support = np.array([each.support for each in there])
            support = support.reshape(len(angles_deg), len(shifts_m), len(shifts_m))
            peaks = np.flatnonzero(support == maximum_filter(support, 3))
            best = peaks[np.argsort(-support.flat[peaks], kind="stable")[:_SEARCH_STARTS]]
            starts += [places[each] for each in best]
        return starts

    def _aligned(
        self, cloud: Cloud, start: Placed, expected: Placed, noise_m: float = _NOISE_M
    ) -> tuple[Placed, Comparison]:
        """The pose near a start and an expected one that puts points on surfaces (Gauss-Newton).

        Also returns the comparison of the last step, close to that pose. Unconstrained directions
        stay at the start.
        """
        pose, velocity = start.pose.copy(), start.velocity.copy()
        shift_holds = noise_m**2 * expected.information
        velocity_holds = noise_m**2 * np.linalg.inv(expected.velocity_covariance)
        for _ in range(_MAX_STEPS):
            there = self._map.compared(cloud, cloud.poses(pose, velocity), noise_m)
            gradient, curvature = there.gradient.copy(), there.curvature.copy()
            gradient[:3] += shift_holds @ (pose[:3, 3] - expected.pose[:3, 3])
            curvature[:3, :3] += shift_holds
            if there.has_velocity:
                gradient[6:] += velocity_holds @ velocity
                curvature[6:, 6:] += velocity_holds
            step = -solved(curvature + _least(curvature), gradient)
            pose[:3, :3] = Rotation.from_rotvec(step[3:6]).as_matrix() @ pose[:3, :3]
            pose[:3, 3] += step[:3]
            if there.has_velocity:
                velocity += step[6:]
            if _distance_m(step[:3], step[3:6]) < _LAST_STEP * noise_m:
                break
        return replace(expected, pose=pose, velocity=velocity), there


def _distance_m(shift: Floats, turn: Floats) -> float:
    """How far distant points move by a shift, metres, and a turn, radians or matrix change."""
    return float(np.abs(shift).max() + _FAR_M * np.abs(turn).max())


def _posterior(pose: Floats, there: Comparison, expected: Placed) -> float:
    """Score of a pose: support minus squared Mahalanobis distance to the expected position."""
    off = pose[:3, 3] - expected.pose[:3, 3]
    return float(there.support - off @ expected.information @ off)


def _likelihood(there: Comparison) -> float:
    """Score of a pose without expectation: upright surfaces, and how well all points fit.

    On the ground alone, or on a lorry alongside, wrong motions fit nearly as well as the true one.
    """
    return float(there.upright * np.sqrt(there.support / max(there.num_known, 1)))


def _known(cloud: Cloud, found: Placed, there: Comparison) -> Placed | None:
    """The pose and its covariance; None if the place is unknown or the pose unconstrained."""
    covariance = _covariance(found, there)
    far_m2 = np.trace(covariance[:2, :2]) + _FAR_M**2 * covariance[5, 5]
    is_held = far_m2 < _MAX_DEVIATION_M**2
    is_known = there.num_known >= _MIN_KNOWN * len(cloud)
    return replace(found, covariance=covariance) if is_held and is_known else None


def _covariance(found: Placed, there: Comparison) -> Floats:
    """(6, 6) of a pose: from the expected position and the points.

    Points have independent errors and a bias common to all.
    """
    curvature = there.curvature + _least(there.curvature)
    arms = curvature.diagonal().reshape(-1, 3).sum(axis=1)
    common = (_COMMON_M * there.support) ** 2 * np.diag(np.repeat(arms / arms[0], 3))
    if there.has_velocity:
        curvature[6:, 6:] += _NOISE_M**2 * np.linalg.inv(found.velocity_covariance)
    errors = _NOISE_M**2 * curvature + common  # covariance of the gradient
    information = curvature @ np.linalg.inv(errors) @ curvature
    information[:3, :3] += found.information
    return np.stack([solved(information, axis) for axis in np.eye(len(information))])[:6, :6]


def _least(curvature: Floats) -> Floats:
    """(U, U) small curvature that keeps unconstrained directions in place."""
    return np.diag(_LEAST_CURVATURE * (1 + np.diag(curvature)))


@compiled("float64[::1](float64[:, ::1], float64[::1])")
def solved(matrix: Floats, right: Floats) -> Floats:
    """Returns (N,) x with matrix x = right, for a positive definite (N, N) matrix, by elimination.

    The digits of a BLAS may depend on its threads, even for six unknowns.
    """
    left, result = matrix.copy(), right.copy()
    for pivot in range(len(result)):
        for row in range(pivot + 1, len(result)):
            factor = left[row, pivot] / left[pivot, pivot]
            result[row] -= factor * result[pivot]
            for column in range(pivot, len(result)):
                left[row, column] -= factor * left[pivot, column]
    for row in range(len(result) - 1, -1, -1):
        for column in range(row + 1, len(result)):
            result[row] -= left[row, column] * result[column]
        result[row] /= left[row, row]
    return result
