# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Registration of a sweep with a map of the sweeps before it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import maximum_filter
from scipy.spatial.transform import Rotation

from mnsf_ros.compiled import compiled
from mnsf_ros.ego_motion.cloud import Cloud
from mnsf_ros.ego_motion.surface_map import Comparison, SurfaceMap
from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.geometry.transforms import planar_pose
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

# Points farther from their surface than this do not count: vehicles that move along.
_SETTLE_WITHIN_M: Final = 0.3
_MAX_STEPS_TO_SETTLE: Final = 6
_MAX_STEPS_TO_REFINE: Final = 10
# Steps smaller than this, in metres at 30 m range, are the last.
_LAST_STEP_M: Final = 0.001
_FAR_M: Final = 30.0
# Each point holds the pose as well as one with this error, which is larger than the noise of
# lidars: neighbouring points err together.
_POINT_M: Final = 0.16
# Keeps directions that nothing is known of where they are.
_LEAST_CURVATURE: Final = 1e-6
# At the beginning nothing is known: 5 m a sweep is 180 km/h at 10 Hz, and a robot that turns on the
# spot makes 10 degrees of it. Angles in degrees and shifts in metres are tried with some points;
# the most promising ones are settled with all.
_SEARCHED: Final = (
    (np.zeros(1), np.linspace(-5.0, 5.0, 25)),
    (np.linspace(-12.0, 12.0, 13), np.linspace(-1.0, 1.0, 5)),
)
_SEARCH_POINTS: Final = 1000
_SEARCH_REACH_M: Final = 0.3
_SEARCH_STARTS: Final = 5
_STANDING_WITHIN_M: Final = 0.15
# A motion that explains fewer of the points is not one to trust: .57 and more for the second sweep
# of random worlds, at 17 m/s with 32 beams; .38 and less for sweeps of other places (tunnels .72).
_MIN_EXPLAINED: Final = 0.47
# Where so few points are on surfaces, nothing holds the motion; .47 and more on streets seen
# with 16 beams, .05 for points too sparse to have surfaces.
_MIN_ON_SURFACES: Final = 0.12
_MIN_POINTS: Final = 50


@dataclass(frozen=True, eq=False)
class Placed:
    """A pose of the sensor, and how well it is known.

    Attributes:
        pose: (4, 4) world_from_sensor.
        covariance: (6, 6) in the axes of the world: metres, then radians.
    """

    pose: NDArray[np.float64]
    covariance: NDArray[np.float64]


class SweepMatcher:
    """Finds the pose of each sweep in the map of the sweeps before it."""

    def __init__(self, settings: EgoMotionSettings) -> None:
        self._settings = settings
        self._map = SurfaceMap(settings.map_cell_m, settings.map_sweeps)
        self._last_pose = np.eye(4)

    @property
    def is_empty(self) -> bool:
        """True before the first sweep."""
        return self._map.is_empty

    def prepared(self, sweep: Sweep, motion: SweepMotion | None) -> Cloud | None:
        """Returns a sweep made ready; None if there are too few points near the sensor.

        With a motion, points are moved to where they are in one moment.
        """
        cloud = Cloud.of(sweep, motion, self._settings)
        return None if len(cloud) < _MIN_POINTS else cloud

    def add(self, cloud: Cloud | None, world_from_sensor: NDArray[np.float64]) -> None:
        """Adds a sweep to the map, taken at a (4, 4) pose."""
        if cloud is not None:
            self._map.add(cloud.points, world_from_sensor)
            self._last_pose = world_from_sensor

    def match(self, cloud: Cloud | None, expected: Placed | None) -> Placed | None:
        """Returns where a sweep was taken.

        The search starts from the expected pose, which is None if nothing is known of the motion.
        Where the map does not hold the position, the expected one does. Returns None if the map
        does not explain the sweep.
        """
        if cloud is None or self.is_empty:
            return None
        if expected is not None:
            how = expected.pose, _SETTLE_WITHIN_M, _MAX_STEPS_TO_SETTLE, expected
            found = _explained(cloud, *self._aligned(cloud.points, *how))
            if found is not None:
                return found
        return self._searched(cloud)

    def _searched(self, cloud: Cloud) -> Placed | None:
        """The pose near the last one, None if there the map does not explain the cloud."""
        points = cloud.points
        settled = [
            self._aligned(points, start, _SETTLE_WITHIN_M, _MAX_STEPS_TO_SETTLE)[0]
            for start in self._starts(cloud)
        ]
        # By the ground, or by a lorry alongside, wrong motions look nearly as good as the true one;
        # by all that stands they do not.
        best = max(
            settled, key=lambda pose: self._num_standing(cloud.standing, pose, _STANDING_WITHIN_M)
        )
        return _explained(
            cloud, *self._aligned(points, best, _SETTLE_WITHIN_M, _MAX_STEPS_TO_REFINE)
        )

    def _starts(self, cloud: Cloud) -> list[NDArray[np.float64]]:
        """The last pose, and the most promising of many around it."""
        some = cloud.standing[:: max(1, cloud.num_standing // _SEARCH_POINTS)]
        starts = [self._last_pose]
        for angles_deg, shifts_m in _SEARCHED:
            places = [
                [
                    self._last_pose @ planar_pose(x, y, np.radians(angle))
                    for x in shifts_m
                    for y in shifts_m
                ]
                for angle in angles_deg
            ]
            counts = np.array(
                [
                    [self._num_standing(some, pose, _SEARCH_REACH_M) for pose in row]
                    for row in places
                ]
            )
            counts = counts.reshape(len(angles_deg), len(shifts_m), len(shifts_m))
            peaks = np.flatnonzero(counts == maximum_filter(counts, 3))
            best = peaks[np.argsort(-counts.flat[peaks], kind="stable")[:_SEARCH_STARTS]]
            starts += [places[each // len(places[0])][each % len(places[0])] for each in best]
        return starts

    def _num_standing(
        self, standing: NDArray[np.float32], pose: NDArray[np.float64], within_m: float
    ) -> int:
        return self._map.compared(standing, pose, within_m).num_on_surfaces

    def _aligned(
        self,
        points: NDArray[np.float32],
        start: NDArray[np.float64],
        within_m: float,
        max_steps: int,
        expected: Placed | None = None,
    ) -> tuple[NDArray[np.float64], Comparison]:
        """The pose near a start and an expected one that puts points on surfaces (Gauss-Newton).

        With it comes the comparison that its last step was made of, the points nearly there. What
        nothing holds stays where it starts.
        """
        if expected is None:
            expected = Placed(start, np.eye(6))
        holds = _POINT_M**2 * np.linalg.inv(expected.covariance[:3, :3])
        pose = start.copy()
        for _ in range(max_steps):
            there = self._map.compared(points, pose, within_m)
            gradient, curvature = there.gradient, there.curvature
            gradient[:3] += holds @ (pose[:3, 3] - expected.pose[:3, 3])
            curvature[:3, :3] += holds
            curvature += np.diag(_LEAST_CURVATURE * (1 + np.diag(curvature)))
            step = -solved(np.ascontiguousarray(curvature), np.ascontiguousarray(gradient))
            pose[:3, :3] = Rotation.from_rotvec(step[3:]).as_matrix() @ pose[:3, :3]
            pose[:3, 3] += step[:3]
            if np.abs(step[:3]).max() + _FAR_M * np.abs(step[3:]).max() < _LAST_STEP_M:
                break
        return pose, there


def _explained(cloud: Cloud, pose: NDArray[np.float64], there: Comparison) -> Placed | None:
    """The pose with its covariance; None if the map does not explain the cloud."""
    is_held = there.num_on_surfaces >= _MIN_ON_SURFACES * len(cloud)
    if not is_held or there.num_explained < _MIN_EXPLAINED * len(cloud):
        return None
    points = np.ascontiguousarray(there.curvature)
    return Placed(pose, _POINT_M**2 * np.stack([solved(points, axis) for axis in np.eye(6)]))


@compiled("float64[::1](float64[:, ::1], float64[::1])")
def solved(matrix: NDArray[np.float64], right: NDArray[np.float64]) -> NDArray[np.float64]:
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
