# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A prepared sweep: its objects above the ground, and a grid of its points."""

from collections.abc import Callable
from copy import copy
from functools import cached_property
from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats32, Ints
from mnsf_ros.compiled import compiled
from mnsf_ros.ego_motion.ego_motion import SensorPose
from mnsf_ros.errors import SweepError
from mnsf_ros.geometry.point_grid import PointGrid
from mnsf_ros.geometry.point_sets import chosen_points, thinned
from mnsf_ros.geometry.segmentation import Segmentation
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.ceiling import ceiling_mask
from mnsf_ros.sweeps.kept_points import MIN_POINTS, ground_under
from mnsf_ros.sweeps.range_view import RangeView
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps.sweep_clock import SweepClock

# A place with a surface so near is not new, and new points so near each other are of one part.
SAME_PLACE_M: Final = 0.25


class ObjectSweep:
    """Built once for each sweep, used as next, current, previous and one of the past.

    Attributes:
        input: The input sweep.
        pose: Pose of the sensor.
        xyz: (N, 3) float32, metres, its points in the sensor frame of one moment.
        kept: (N,) bool, the points inside the crop that are not ground, own body, ceiling, or too
            high.
        ground: The ground under it.
        own: (N,) bool, the points on the own body.
        ceiling: (N,) bool, the points on a ceiling.
        heights: (N,) float32, metres above ground of its points. NaN says: outside the crop, or on
            the own body. -infinity says: on a ceiling, or above `objects.max_height_m`.
        clock: Measuring time of each direction; None if unknown.
        thinned: (T, 3) float32, metres, sensor frame: the kept points, one for each small cell.
        thinned_objects: (T,) int, their objects.
        grid: The thinned points in cells.
        wholes: (all objects,) int, the object that each was cut out of, see `split`; else its
            own number.
        members: (M, 3) metres, the thinned points of each object, and (M,) their objects. Points of
            a part are points of its whole, too.
        is_short_enough: (all objects,) those not too long to move, see `objects.max_size_m`.
    """

    def __init__(
        self, sweep: Sweep, pose: SensorPose, settings: Settings, own: Bools | None = None
    ) -> None:
        """Crops, removes ground and own body, segments.

        Raises:
            SweepError: If too few points are left.
        """
        self.input = sweep
        self.pose = pose
        self.xyz = pose.in_one_moment(sweep)
        self.ground, self.heights = ground_under(self.xyz, settings)
        lowest_m = settings.ground.margin_m if settings.ground.remove else -np.inf
        if settings.ground.remove:
            # Seen from above, an object under a ceiling or a tree would merge with it. Beside a
            # dam, the ground may be far below the road.
            is_high = (self.heights > settings.objects.max_height_m) & (self.xyz[:, 2] > 0)
            self.heights[is_high] = -np.inf
        self.own = np.zeros(len(sweep), np.bool_) if own is None else own
        self.heights[self.own] = np.nan
        self.ceiling: Bools = np.zeros(len(sweep), np.bool_)
        if settings.ground.remove:
            self.ceiling = ceiling_mask(self.xyz, self.heights > lowest_m, settings.ground)
            self.heights[self.ceiling] = -np.inf
        self.kept = self.heights > lowest_m
        self.clock = None
        if pose.motion is not None and sweep.times_s is not None:
            self.clock = SweepClock.of(self.xyz, sweep.times_s, sweep.beams_from_sensor)
        # A mover is elsewhere when it is seen again: objects consist of first views.
        self._in_objects = self.kept if self.clock is None else self.kept & ~self.clock.is_again
        points = self._points = chosen_points(self.xyz, self._in_objects)
        if len(points) < MIN_POINTS:
            raise SweepError(
                f"{sweep}: {len(points)} of {len(sweep)} points are left after crop "
                f"and ground removal, expected at least {MIN_POINTS}"
            )
        segmentation = Segmentation(points, settings.objects.cell_size_m)
        self.thinned = _thinned(points, settings)
        self.grid = PointGrid(self.thinned)
        self._max_size_m = settings.objects.max_size_m
        self._group(
            segmentation.objects_of(self.thinned),
            segmentation.objects_of(points),
            np.arange(segmentation.num_objects),
        )

    def _group(self, thinned_objects: Ints, point_objects: Ints, wholes: Ints) -> None:
        """Puts the points into objects: sets all that depends on these."""
        self.thinned_objects, self._point_objects = thinned_objects, point_objects
        self.wholes = wholes
        whole_of = wholes[thinned_objects]
        of_parts = np.flatnonzero(whole_of != thinned_objects)
        points = np.concatenate([self.thinned, np.take(self.thinned, of_parts, axis=0)])
        self.members = points, np.append(whole_of, thinned_objects[of_parts])
        self.is_short_enough = np.asarray(self.sizes < self._max_size_m)

    @cached_property
    def view(self) -> RangeView:
        """The range image of the sweep."""
        return RangeView(self.xyz, self.input.beams_from_sensor)

    @property
    def stamp_ns(self) -> int:
        """Time of the sweep."""
        return self.input.stamp_ns

    @property
    def num_objects(self) -> int:
        """Number of objects; number 0 is none."""
        return len(self.wholes)

    @property
    def counts(self) -> Ints:
        """(all objects,) how many thinned points each has."""
        return np.bincount(self.members[1], minlength=self.num_objects)

    @property
    def sizes(self) -> Floats32:
        """(all objects,) metres, the longer horizontal side of the box around each; 0 for none."""
        return sizes_of(*self.members, self.num_objects)

    def relabelled(self, relabel: Callable[[Floats32, Ints], Ints], wholes: Ints) -> "ObjectSweep":
        """Returns the same sweep with its points in other objects.

        Args:
            relabel: Points (N, 3) and their objects (N,) to their new objects (N,).
            wholes: Of the new objects.
        """
        other = copy(self)
        other._group(
            relabel(self.thinned, self.thinned_objects),
            relabel(self._points, self._point_objects),
            wholes,
        )
        return other

    def object_ids(self) -> Ints:
        """(N,) the object of each point of the sweep.

        It is 0 for ground, cropped points, and points that were seen a second time.
        """
        object_ids = np.zeros(len(self.xyz), dtype=np.int64)
        object_ids[self._in_objects] = self._point_objects
        return object_ids


def _thinned(points: Floats32, settings: Settings) -> Floats32:
    stride = max(1, -(-len(points) // settings.objects.max_points))
    return thinned(points[::stride], settings.objects.thinning_m)


@compiled("float32[::1](float32[:, ::1], int64[::1], int64)")
def sizes_of(points: Floats32, objects: Ints, num_objects: int) -> Floats32:
    """Returns (num_objects,) the `ObjectSweep.sizes` of points (N, 3) of objects (N,)."""
    low = np.full((num_objects, 2), np.float32(np.inf), np.float32)
    high = np.full((num_objects, 2), np.float32(-np.inf), np.float32)
    for point in range(len(points)):
        for axis in range(2):
            place, each = points[point, axis], objects[point]
            low[each, axis] = min(low[each, axis], place)
            high[each, axis] = max(high[each, axis], place)
    sizes = np.zeros(num_objects, np.float32)
    for each in range(num_objects):
        sizes[each] = max(
            high[each, 0] - low[each, 0], high[each, 1] - low[each, 1], np.float32(0.0)
        )
    return sizes
