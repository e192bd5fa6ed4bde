# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The last sweeps made ready, each once, in the order in which they came."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Final, TypeVar

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource, SensorPose
from mnsf_ros.errors import SweepError
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.target import Target
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# How far back an object is looked for: three and six sweeps at 10 Hz. Before the first a car has
# not turned by much, before the second a slow pedestrian has moved by more than the noise.
_PAST_S: Final = (0.3, 0.6)
_PAST_TOLERANCE_S: Final = 0.12
_MAX_SWEEPS: Final = 12

Item = TypeVar("Item")


@dataclass(frozen=True, eq=False)
class ReadySweeps:
    """The sweeps of one triplet and those before it, all in one world. Never changed.

    Attributes:
        last: Oldest first; the last one is the triplet's next sweep.
        of_triplet: The previous sweep, if there is one, the current and the next one.
        world: Number of the world that their poses are in.
        time_ms: What it took to make those ready that were not.
    """

    last: tuple[ObjectSweep, ...]
    of_triplet: tuple[ObjectSweep, ...]
    world: int
    time_ms: float

    def past(self, current: ObjectSweep, interval_s: float) -> list[Target]:
        """Older sweeps to test motions on, as far as there are any, the youngest first.

        Args:
            current: The current sweep.
            interval_s: Time to the next sweep.
        """
        if interval_s <= 0:
            return []
        ages: dict[ObjectSweep, float] = {}
        for sweep in reversed(self.last):
            age = (current.sweep.stamp_ns - sweep.sweep.stamp_ns) / NANOSECONDS
            if age > 0:
                ages[sweep] = age
            if age >= 0 and sweep.pose.source is EgoSource.CONSTANT_VELOCITY:
                # Its pose relative to the earlier sweeps is not known.
                break
        found: list[ObjectSweep] = []
        for past_s in _PAST_S:
            near = {
                abs(age - past_s): sweep
                for sweep, age in ages.items()
                if abs(age - past_s) < _PAST_TOLERANCE_S and age > 1.5 * interval_s
            }
            found += [near[min(near)]] if near else []
        return [Target.of(sweep, current, -ages[sweep] / interval_s) for sweep in found]


class PreparedSweeps:
    """Finds the poses of sweeps and makes them ready. For one thread at a time."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._ego_motion = EgoMotion(settings.ego_motion)
        self._world = 0
        self._poses: dict[Sweep, SensorPose] = {}
        self._sweeps: dict[Sweep, ObjectSweep] = {}

    def with_settings(self, settings: Settings) -> PreparedSweeps:
        """Returns the same for other settings, with what still holds.

        The world and the poses in it depend on `ego_motion` only; what an object is depends on
        `crop`, `ground` and `objects`, too. These sweeps must not be used afterwards.
        """
        other = PreparedSweeps(settings)
        other._world = self._world
        if settings.ego_motion == self._settings.ego_motion:
            other._ego_motion, other._poses = self._ego_motion, self._poses
            if self.are_same_for(settings):
                other._sweeps = self._sweeps
        return other

    def are_same_for(self, settings: Settings) -> bool:
        """Whether other settings make the same of a sweep."""
        return _all_that_matters(settings) == _all_that_matters(self._settings)

    def ready(self, *sweeps: Sweep) -> ReadySweeps:
        """The sweeps of a triplet made ready, those that are not yet.

        Args:
            sweeps: Oldest first; each is later than those made ready before, or one of them.

        Raises:
            SweepError: If too few points of one are left, or if one cannot follow that before it:
                it is older, of another frame, or comes after too long a gap.
        """
        start_s = time.perf_counter()
        # All poses first: how the sensor moved in the first sweep is known from the second one.
        for sweep in sweeps:
            if sweep not in self._poses:
                self._add_pose(sweep)
        for sweep in sweeps:
            if sweep in self._poses and sweep not in self._sweeps:
                self._add(sweep)
        if any(sweep not in self._sweeps for sweep in sweeps):
            # The map was restarted in between: poses before and after cannot be related.
            raise SweepError(
                "the sweeps of the triplet do not follow each other, "
                f"expected one frame_id, rising stamps and no gap above ego_motion.max_gap_s, "
                f"which is {self._settings.ego_motion.max_gap_s:g}"
            )
        of_triplet = tuple(self._sweeps[sweep] for sweep in sweeps)
        time_ms = (time.perf_counter() - start_s) * 1e3
        return ReadySweeps(tuple(self._sweeps.values()), of_triplet, self._world, time_ms)

    def _add_pose(self, sweep: Sweep) -> None:
        pose = self._ego_motion.pose_of(sweep)
        if pose.source is EgoSource.START:
            # The map was restarted: earlier poses no longer hold.
            self._world += 1
            self._poses.clear()
            self._sweeps.clear()
        _keep_last(self._poses, sweep, pose)

    def _add(self, sweep: Sweep) -> None:
        pose = self._poses[sweep]
        if pose.source is EgoSource.START:
            pose = replace(pose, motion=self._ego_motion.motion_in(sweep))
        # Here, not after a whole triplet: there may never be one if every third sweep is refused.
        _keep_last(self._sweeps, sweep, ObjectSweep(sweep, pose, self._settings))


def _all_that_matters(settings: Settings) -> tuple[object, ...]:
    return settings.ego_motion, settings.crop, settings.ground, settings.objects


def _keep_last(items: dict[Sweep, Item], sweep: Sweep, item: Item) -> None:
    """Adds an item and drops those of the oldest sweeps."""
    items[sweep] = item
    while len(items) > _MAX_SWEEPS:
        del items[next(iter(items))]
