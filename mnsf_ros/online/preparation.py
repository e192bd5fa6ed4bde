# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Preparation: each sweep once; then the sweeps of one estimate."""

import time
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from mnsf_ros.core.flow_estimate import Effort
from mnsf_ros.ego_motion.ego_motion import MAX_SWEEPS, EgoSource, SensorPose, SensorPoses
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.own_body import OwnBody
from mnsf_ros.online.target import Target, Targets
from mnsf_ros.settings import ObjectSettings, Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep, SweepTriplet

# Ages of the older sweeps: three and six sweeps at 10 Hz. Within the first a car does not turn by
# much; within the second a slow pedestrian moves by more than the noise.
_PAST_S: Final = (0.3, 0.6)
# Half of the time between them: no sweep is the nearest to both.
_MAX_OFF_S: Final = 0.15
# Younger sweeps are neighbours of the current one, not older sweeps.
_MIN_INTERVALS: Final = 1.5
# Effort to what `objects.max_suspects` is divided by.
_DIVISORS: Final = {Effort.HALF: 2, Effort.LEAST: 4}


@dataclass(frozen=True, eq=False)
class PreparedSweeps:
    """The sweeps of one triplet and those before it, all in one world. Never changed.

    Attributes:
        known: Oldest first; the last one is the triplet's next sweep.
        of_triplet: The previous sweep, if there is one, the current and the next one.
        time_ms: Run time of the preparation of sweeps that were not ready yet.
    """

    known: tuple[ObjectSweep, ...]
    of_triplet: tuple[ObjectSweep, ...]
    time_ms: float

    def near(self, interval_ratio: float) -> list[Target]:
        """Neighbouring sweeps to test motions on: the next one, and the previous one if known.

        Args:
            interval_ratio: Of the triplet.
        """
        *previous, current, next_ = self.of_triplet
        near = [Target.of(next_, current, 1.0)]
        if current.pose.source is not EgoSource.LOST:
            # Otherwise the current sweep cannot be related to the previous one.
            near += [Target.of(sweep, current, -1.0 / interval_ratio) for sweep in previous]
        return near

    def past(self, current: ObjectSweep, interval_s: float) -> list[Target]:
        """Available older sweeps to test motions on, the youngest first.

        Args:
            current: The current sweep.
            interval_s: Time to the next sweep.
        """
        if interval_s <= 0:
            return []
        by_age: dict[float, ObjectSweep] = {}
        for sweep in _related(one for one in self.known if one.stamp_ns <= current.stamp_ns):
            age_s = (current.stamp_ns - sweep.stamp_ns) / NANOSECONDS
            if age_s > _MIN_INTERVALS * interval_s:
                by_age[age_s] = sweep
        found = []
        for past_s in _PAST_S:
            near = [age_s for age_s in by_age if abs(age_s - past_s) < _MAX_OFF_S]
            if near:
                # Of two that are equally near, the older one.
                age_s = min(near, key=lambda age_s: (abs(age_s - past_s), -age_s))
                found.append(Target.of(by_age[age_s], current, -age_s / interval_s))
        return found


class Preparation:
    """Finds the poses of sweeps and makes them ready. For one thread at a time."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._poses = SensorPoses(settings.ego_motion)
        self._own_body = OwnBody(settings.crop)
        self._sweeps: dict[Sweep, ObjectSweep] = {}

    def begin_with(self, known: "Preparation") -> None:
        """Takes over the own body that was learned before a break of the stream."""
        self._own_body.begin_with(known._own_body)

    def prepare(self, triplet: SweepTriplet) -> PreparedSweeps:
        """Prepares the sweeps of a triplet that are not ready yet.

        Raises:
            SweepError: If too few points of one are left.
        """
        start_s = time.perf_counter()
        sweeps = (*triplet.before[:1], triplet.current, triplet.next)
        # All poses first: how the sensor moved in the first sweep is known from the second one.
        for sweep, pose in self._poses.of(sweeps).items():
            if sweep not in self._sweeps:
                self._add(sweep, pose)
        of_triplet = tuple(self._sweeps[sweep] for sweep in sweeps)
        time_ms = (time.perf_counter() - start_s) * 1e3
        return PreparedSweeps(tuple(self._sweeps.values()), of_triplet, time_ms)

    def _add(self, sweep: Sweep, pose: SensorPose) -> None:
        if pose.source is EgoSource.START:
            pose = replace(pose, motion=self._poses.motion_in(sweep))
        # Here, not after a whole triplet: there may never be one if every third sweep is refused.
        own = self._own_body.mask(sweep)
        self._sweeps[sweep] = ready = ObjectSweep(sweep, pose, self._settings, own)
        *_, earliest = _related(self._sweeps.values())
        self._own_body.learn(ready, earliest)
        while len(self._sweeps) > MAX_SWEEPS:
            del self._sweeps[next(iter(self._sweeps))]


def _related(sweeps: Iterable[ObjectSweep]) -> Iterator[ObjectSweep]:
    """Yields the sweeps whose poses relative to the last one are known, the last one first.

    The pose of a sweep with a guessed motion is not known relative to earlier ones.
    """
    for sweep in reversed([*sweeps]):
        yield sweep
        if sweep.pose.source is EgoSource.LOST:
            return


@dataclass(frozen=True, eq=False)
class Scene:
    """Input of one estimate: the current sweep and its targets.

    Attributes:
        current: The middle sweep.
        targets: The other sweeps.
        interval_s: Time to the next sweep; 0 without stamps.
        settings: Settings of the objects; less work where the effort is lower.
    """

    current: ObjectSweep
    targets: Targets
    interval_s: float
    settings: ObjectSettings

    @classmethod
    def of(
        cls,
        triplet: SweepTriplet,
        prepared: PreparedSweeps,
        settings: ObjectSettings,
        effort: Effort,
    ) -> "Scene":
        """Returns the scene of a triplet whose sweeps are ready."""
        *_, current, _ = prepared.of_triplet
        near = prepared.near(triplet.interval_ratio)
        interval_s = max(0.0, triplet.interval_s)
        past = prepared.past(current, interval_s) if effort is Effort.FULL else []
        max_suspects = max(1, settings.max_suspects // _DIVISORS.get(effort, 1))
        limited = replace(settings, max_suspects=max_suspects)
        return cls(current, Targets(near, past), interval_s, limited)

    def with_current(self, current: ObjectSweep) -> "Scene":
        """Returns the scene with the points of the current sweep in other objects."""
        near, past = (
            [replace(target, current=current) for target in each]
            for each in (self.targets.near, self.targets.past)
        )
        return replace(self, current=current, targets=Targets(near, past))

    @property
    def usual_interval_s(self) -> float:
        """The time to the next sweep in seconds, or its usual value if that is not known."""
        return self.interval_s or USUAL_INTERVAL_S
