# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Target: another sweep that moved points of the current one are compared with."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.object_sweep import SAME_PLACE_M, ObjectSweep
from mnsf_ros.sweeps.sweep import NANOSECONDS

# Limit of the residual of a point that would be hidden or out of view; else it is the reach.
_HIDDEN_M: Final = 0.1
# Iterations of the fit of a motion to a target.
NUM_ITERATIONS: Final = 4
# An object measured at the end of one sweep and at the beginning of the next has hardly moved. Its
# share of the interval is at least this.
_MIN_SHARE_OF_INTERVAL: Final = 0.5


@dataclass(frozen=True, eq=False)
class Target:
    """A sweep to compare with.

    Attributes:
        sweep: The sweep.
        from_current: (4, 4), target_from_current of static points.
        time_ratio: Time to this sweep, in intervals to the next sweep: 1 for the next sweep, -1 for
            the previous one if both are equally far.
        current: The current sweep.
    """

    sweep: ObjectSweep
    from_current: Floats
    time_ratio: float
    current: ObjectSweep

    @classmethod
    def of(cls, sweep: ObjectSweep, current: ObjectSweep, time_ratio: float) -> "Target":
        """Returns another sweep as a target for the current one."""
        target_from_world = np.linalg.inv(sweep.pose.world_from_sensor)
        from_current: Floats = target_from_world @ current.pose.world_from_sensor
        return cls(sweep, from_current, time_ratio, current)

    @cached_property
    def to_current(self) -> Floats:
        """(4, 4) current_from_target of static points."""
        return np.asarray(np.linalg.inv(self.from_current), dtype=np.float64)

    def reversed(self) -> "Target":
        """Returns the current sweep as a target for this sweep."""
        return Target(self.current, self.to_current, -self.time_ratio, self.sweep)

    def time_ratios_of(self, objects: ObjectPoints, motions: Floats32) -> Floats32:
        """Returns `time_ratio` as (1, 1), or as (K, 1) by the times at which objects were measured.

        A turning lidar meets an object that changes its azimuth sooner or later than after the
        interval of the sweeps, by up to a revolution where a sweep begins.

        Args:
            objects: K objects.
            motions: (K, 3) metres, to the next sweep.
        """
        ratios = np.full((1, 1), self.time_ratio, np.float32)
        here, there = self.current.clock, self.sweep.clock
        between_s = (self.sweep.stamp_ns - self.current.stamp_ns) / NANOSECONDS
        if here is None or there is None or between_s == 0 or len(objects) == 0:
            return ratios
        moved = transformed(objects.centers + ratios * motions, self.from_current)
        late_s = there.times_of(moved) - here.times_of(objects.centers)
        shares = np.maximum((between_s + late_s) / between_s, _MIN_SHARE_OF_INTERVAL)
        return (shares[:, None] * self.time_ratio).astype(np.float32)

    def pulls(self, objects: ObjectPoints, displacements: Floats32) -> Floats:
        """Returns (K, 3) metres, mean offsets of objects to the nearest points of the target.

        Args:
            objects: K objects.
            displacements: (K, 3) metres, their motions until the time of the target.
        """
        exactly = np.zeros_like(objects.spacing)
        _, vectors, counts = self.sweep.grid.compared(
            objects.positions, objects.owners, displacements, self.from_current, exactly
        )
        means = vectors / np.maximum(counts, 1)[:, None]
        return turned(means, self.from_current[:3, :3].T)

    def are_new(self, points: Floats32) -> Bools:
        """Returns (P,) which points (P, 3) are new: the sweep saw through, and had none near."""
        places = transformed(points, self.from_current)
        is_new = self.sweep.view.are_free(places)
        free = chosen_points(places, is_new)
        is_new[is_new] = self.sweep.grid.nearest(free, SAME_PLACE_M) < 0
        return is_new

    @cached_property
    def gone(self) -> Floats32:
        """(G, 3) metres, current frame, points of possible movers whose places are free by now."""
        is_short_enough = self.sweep.is_short_enough[self.sweep.thinned_objects]
        points = chosen_points(self.sweep.thinned, is_short_enough)
        is_gone = self.reversed().are_new(points)
        return transformed(chosen_points(points, is_gone), self.to_current)

    @property
    def objects_near_gone(self) -> Ints:
        """The numbers of the objects of the current sweep that are near points that are gone."""
        nearest = self.current.grid.nearest(self.gone)
        objects = self.current.thinned_objects[nearest[nearest >= 0]]
        return np.append(objects, self.current.wholes[objects])

    def num_free(self, objects: ObjectPoints, motions: Floats32) -> Ints:
        """Returns (K,) how many points of each object are in free space of the sweep.

        Args:
            objects: K objects.
            motions: (K, 3) metres, to the next sweep.
        """
        moved = objects.positions + self.displacements(objects, motions)[objects.owners]
        free = self.sweep.view.are_free(transformed(moved, self.from_current))
        return np.asarray(objects.sums(free.astype(np.int64)), np.int64)

    def rows_of_gone(self, places: Floats32) -> Ints:
        """Returns (M,) the row of the nearest place for each point of `gone` that is near one.

        Args:
            places: (P, 3) metres, current frame.
        """
        nearest = PointGrid(places).nearest(self.gone, SAME_PLACE_M)
        return nearest[nearest >= 0]

    def are_unseen(self, places: Floats32) -> Bools:
        """Returns (P,) which places (P, 3), frame of the target, are hidden or out of view.

        They are behind a surface, above or below all beams, or in a direction without returns in
        both sweeps.
        """
        view = self.sweep.view
        return view.are_hidden(places) | view.are_out(places, self.current.view)

    def limits_m(self, objects: ObjectPoints, displacements: Floats32) -> Floats32:
        """Returns (P,) metres, the largest residuals of points that are moved to this sweep.

        Args:
            objects: Of P points.
            displacements: (P, 3) metres, how far they are moved.
        """
        places = transformed(objects.positions + displacements, self.from_current)
        return self.sweep.view.limits_m(places, self.current.view, REACH_M, _HIDDEN_M)

    def residuals(
        self, objects: ObjectPoints, motions: Floats32, max_mean_m: Floats | None = None
    ) -> Floats:
        """Returns the residuals of moved objects: mean distance to the target beyond the spacing.

        Args:
            objects: K objects.
            motions: (K, 3) metres, to the next sweep.
            max_mean_m: (K,) metres; residuals above need not be exact.

        Returns:
            (K,) metres, mean over each object's points, truncated by `limits_m`.
        """
        displacements = self.displacements(objects, motions)
        sums, _, _ = self.sweep.grid.compared(
            objects.positions,
            objects.owners,
            displacements,
            self.from_current,
            objects.spacing,
            self.limits_m(objects, displacements[objects.owners]),
            None if max_mean_m is None else max_mean_m * objects.counts,
        )
        return np.asarray(sums / objects.counts, np.float64)

    def displacements(self, objects: ObjectPoints, motions: Floats32) -> Floats32:
        """Returns (K, 3) metres, the motions of objects until the time of the target.

        Args:
            objects: K objects.
            motions: (K, 3) metres, to the next sweep.
        """
        return self.time_ratios_of(objects, motions) * motions if motions.any() else motions


@dataclass(frozen=True)
class Targets:
    """The other sweeps that motions are judged on.

    Attributes:
        near: Next sweep, and previous sweep where there is one.
        past: Older sweeps, the youngest first, where there are some.
    """

    near: Sequence[Target]
    past: Sequence[Target]

    @property
    def next(self) -> Target:
        """The next sweep."""
        return self.near[0]

    @property
    def previous(self) -> Target | None:
        """The previous sweep, where there is one."""
        return self.near[1] if len(self.near) > 1 else None
