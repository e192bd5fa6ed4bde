"""Registration of sweeps against a local map of the last ones, by small_gicp's voxel GICP."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import small_gicp
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.ego_motion.sweep_motion import SweepMotion
from mnsf_ros.settings import EgoMotionSettings
from mnsf_ros.sweeps.sweep import Sweep

# Pairs of points farther apart than this do not count: first to find the motion, then to settle
# it. In dense traffic the second pass is what frees the result from vehicles that move along:
# .04 m of error a sweep with the first pass alone, .007 m with both.
_FIND_WITHIN_M: Final = 1.0
_SETTLE_WITHIN_M: Final = 0.3
# More steps than these change the result by less than a millimetre.
_MAX_STEPS_TO_FIND: Final = 2
_MAX_STEPS_TO_SETTLE: Final = 4
# At the beginning nothing is known: 5 m a sweep is 180 km/h at 10 Hz.
_SEARCH_WITHIN_M: Final = (5.0, 2.0)
# Where the search starts, beside the last sweep. From one place alone it ends in a wrong minimum
# on half of the simulated streets at 3 m a sweep, with .7 instead of .9 of the points explained.
_SEARCH_FROM_M: Final = ((0.0, 0.0), (2.5, 0.0), (-2.5, 0.0), (0.0, 2.5), (0.0, -2.5))
# And so far ahead and behind, in such steps: what stands must lie this close to itself.
_SEARCH_AHEAD_M: Final = 5.0
_SEARCH_STEP_M: Final = 0.4
_STANDING_WITHIN_M: Final = 0.15
# A pose farther from the expected one than this has to be better than it.
_DRAGGED_M: Final = 0.15
_NUM_NEIGHBORS: Final = 7
# Points within this height of the lowest one of a column are mostly ground, which is smooth: on it
# cells are larger by this factor.
_COLUMN_M: Final = 1.0
_LOW_M: Final = 0.3
_LOW_CELLS: Final = 1.7
# A motion that leads fewer of the points near the map than this is not one to trust; .88 to .97
# on the recordings at hand.
_MIN_EXPLAINED: Final = 0.6
_MIN_POINTS: Final = 50


@dataclass(frozen=True, eq=False)
class Cloud:
    """A thinned sweep with covariances, sensor frame."""

    points: small_gicp.PointCloud
    tree: small_gicp.KdTree
    num_standing: int  # the first ones, which are not low

    @property
    def standing(self) -> NDArray[np.float64]:
        """(S, 3) metres, the points that are not near the ground."""
        points: NDArray[np.float64] = self.points.points()[: self.num_standing, :3]
        return points


class SweepMatcher:
    """Finds the pose of each sweep in the map of the sweeps before it.

    Where sums of several threads would depend on their timing it uses one only.

    Attributes:
        num_threads: The most threads that it may use.
    """

    def __init__(self, settings: EgoMotionSettings, num_threads: int = 1) -> None:
        self.num_threads = num_threads
        self._settings = settings
        self._map = small_gicp.GaussianVoxelMap(settings.map_cell_m)
        self._map.set_lru(horizon=settings.map_sweeps)
        self._last: tuple[Cloud, NDArray[np.float64]] | None = None

    @property
    def is_empty(self) -> bool:
        """Whether there is nothing yet to match with."""
        return self._last is None

    def add(self, cloud: Cloud | None, world_from_sensor: NDArray[np.float64]) -> None:
        """Adds a sweep to the map, taken at a (4, 4) pose."""
        if cloud is not None:
            self._map.insert(cloud.points, world_from_sensor)
            self._last = cloud, world_from_sensor

    def match(
        self, cloud: Cloud | None, expected: NDArray[np.float64] | None
    ) -> NDArray[np.float64] | None:
        """Returns the (4, 4) pose at which a sweep was taken.

        The search starts from the expected pose, which is None if nothing is known of the motion.
        Returns None if the map does not explain the sweep.
        """
        if cloud is None or self._last is None:
            return None
        found = None if expected is None else self._found(cloud, expected)
        if found is None:
            found = self._searched(cloud, *self._last)
        return found

    def _found(self, cloud: Cloud, expected: NDArray[np.float64]) -> NDArray[np.float64] | None:
        """The pose near an expected one, None if there the map does not explain the cloud."""
        found = self._aligned(cloud, expected, _FIND_WITHIN_M, _MAX_STEPS_TO_FIND)
        if found.num_inliers < _MIN_EXPLAINED * cloud.points.size():
            return None
        starts = [np.asarray(found.T_target_source)]
        if np.linalg.norm(starts[0][:3, 3] - expected[:3, 3]) > _DRAGGED_M:
            # Traffic alongside may have led the search astray.
            starts.append(expected)
        return self._settled(cloud, starts)

    def _searched(
        self, cloud: Cloud, last: Cloud, world_from_last: NDArray[np.float64]
    ) -> NDArray[np.float64] | None:
        """The pose near the last one, None if there the map does not explain the cloud."""
        starts = [self._beside(last, world_from_last, cloud, shift) for shift in _SEARCH_FROM_M]
        for x in np.arange(-_SEARCH_AHEAD_M, _SEARCH_AHEAD_M + _SEARCH_STEP_M, _SEARCH_STEP_M):
            ahead = np.eye(4)
            ahead[0, 3] = x
            starts.append(world_from_last @ ahead)
        best = self._settled(cloud, starts)
        if best is None:
            return None
        near = self._aligned(cloud, best, _FIND_WITHIN_M, 1)
        return best if near.num_inliers >= _MIN_EXPLAINED * cloud.points.size() else None

    def _settled(
        self, cloud: Cloud, starts: Sequence[NDArray[np.float64]]
    ) -> NDArray[np.float64] | None:
        """The pose near one of several that explains most of what stands on the ground.

        By the ground, or by a lorry alongside, wrong motions look nearly as good as the true one;
        by all that stands they do not.
        """
        poses = [
            np.asarray(
                self._aligned(cloud, start, _SETTLE_WITHIN_M, _MAX_STEPS_TO_SETTLE).T_target_source
            )
            for start in starts
        ]
        poses = [pose for pose in poses if np.isfinite(pose).all()]
        if len(poses) < 2 or self._last is None:
            return next(iter(poses), None)
        last, world_from_last = self._last
        tree, last_from_world = cKDTree(last.standing), np.linalg.inv(world_from_last)

        def num_explained(pose: NDArray[np.float64]) -> int:
            last_from_this = last_from_world @ pose
            there = cloud.standing @ last_from_this[:3, :3].T + last_from_this[:3, 3]
            distances, _ = tree.query(there, distance_upper_bound=_STANDING_WITHIN_M)
            return int(np.count_nonzero(np.isfinite(distances)))

        return max(poses, key=num_explained)

    def _aligned(
        self, cloud: Cloud, start: NDArray[np.float64], within_m: float, max_steps: int
    ) -> small_gicp.RegistrationResult:
        return small_gicp.align(
            self._map,
            cloud.points,
            start,
            max_correspondence_distance=within_m,
            max_iterations=max_steps,
            num_threads=1,
        )

    def _beside(
        self,
        last: Cloud,
        world_from_last: NDArray[np.float64],
        cloud: Cloud,
        shift_m: tuple[float, float],
    ) -> NDArray[np.float64]:
        """A pose from the last sweep alone. The map sees no farther than one of its cells."""
        last_from_this = np.eye(4)
        last_from_this[:2, 3] = shift_m
        for within_m in _SEARCH_WITHIN_M:
            result = small_gicp.align(
                last.points,
                cloud.points,
                last.tree,
                last_from_this,
                max_correspondence_distance=within_m,
                num_threads=1,
            )
            last_from_this = np.asarray(result.T_target_source)
        pose: NDArray[np.float64] = world_from_last @ last_from_this
        return pose

    def prepared(self, sweep: Sweep, motion: SweepMotion | None) -> Cloud | None:
        """Returns a sweep made ready; None if there are too few points near the sensor.

        With a motion, points are moved to where they are in one moment.
        """
        stride = max(1, -(-len(sweep) // self._settings.max_points))
        points = sweep.xyz[::stride]
        if motion is not None and sweep.times_s is not None:
            points = motion.moved(points, sweep.times_s[::stride])
        with np.errstate(over="ignore"):  # infinite is far away, too
            squared_ranges = points[:, 0] ** 2 + points[:, 1] ** 2
        near = squared_ranges < np.float32(self._settings.max_range_m**2)
        # small_gicp complains on stderr of heights that it cannot number.
        near &= np.abs(points[:, 2]) < np.float32(self._settings.max_range_m)
        points = np.compress(near, points, axis=0)
        if len(points) < _MIN_POINTS:
            return None
        cloud, num_standing = self._thinned(points)
        if cloud.size() < _MIN_POINTS:
            return None
        tree = small_gicp.KdTree(cloud, num_threads=1)
        # Each point by itself: here threads change nothing in the result.
        small_gicp.estimate_covariances(cloud, tree, _NUM_NEIGHBORS, num_threads=self.num_threads)
        return Cloud(cloud, tree, num_standing)

    def _thinned(self, points: NDArray[np.float32]) -> tuple[small_gicp.PointCloud, int]:
        """Returns one point for each cell of (N, 3) points, larger cells near the ground.

        The number is that of the points that are not near the ground; they come first.
        """
        is_low = _are_low(points)
        cell_m = self._settings.thinning_m
        parts = [
            small_gicp.voxelgrid_sampling(
                np.compress(chosen, points, axis=0).astype(np.float64), size_m, num_threads=1
            ).points()
            for chosen, size_m in ((~is_low, cell_m), (is_low, _LOW_CELLS * cell_m))
        ]
        return small_gicp.PointCloud(np.concatenate(parts)[:, :3]), len(parts[0])


def _are_low(points: NDArray[np.float32]) -> NDArray[np.bool_]:
    """Returns (N,) whether points (N, 3), metres, are near the lowest one of their column."""
    x, y, z = (np.ascontiguousarray(points[:, axis]) for axis in range(3))
    rows, columns = (
        ((axis - axis.min()) / np.float32(_COLUMN_M)).astype(np.int32) for axis in (x, y)
    )
    cells = rows * (columns.max() + 1) + columns
    lowest = np.full(cells.max() + 1, np.inf, np.float32)
    np.minimum.at(lowest, cells, z)
    are_low: NDArray[np.bool_] = z < lowest[cells] + np.float32(_LOW_M)
    return are_low
