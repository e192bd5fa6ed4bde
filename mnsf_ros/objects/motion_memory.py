"""What one triplet keeps for the next: prepared sweeps, and the tracks of what moves."""

from __future__ import annotations

from dataclasses import replace
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import Start
from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource, SensorPose
from mnsf_ros.errors import SweepError
from mnsf_ros.objects.expectation import Expectation
from mnsf_ros.objects.following import alive, follow
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.target import Target
from mnsf_ros.objects.tracks import Tracks
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep, SweepTriplet

# How far back an object is looked for: three and six sweeps at 10 Hz. Before the first a car has
# not turned by much, before the second a slow pedestrian has moved by more than the noise.
_PAST_S: Final = (0.3, 0.6)
_PAST_TOLERANCE_S: Final = 0.12
_MAX_SWEEPS: Final = 12

Item = TypeVar("Item")


class MotionMemory:
    """Remembers the last sweeps and motions, as long as time goes on and the frame is the same."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._ego_motion = EgoMotion(settings.ego_motion)
        self._poses: dict[Sweep, SensorPose] = {}
        self._sweeps: dict[Sweep, ObjectSweep] = {}
        self._tracks: Tracks | None = None
        self._next_id = 1

    def with_settings(self, settings: Settings) -> MotionMemory:
        """Returns a memory for other settings, with what this one knows if that still holds.

        The world and the poses in it depend on `ego_motion` only; what an object is depends on
        `crop`, `ground` and `objects`, too.
        """
        other, last = MotionMemory(settings), self._settings
        other._next_id = self._next_id
        if settings.ego_motion == last.ego_motion:
            other._ego_motion, other._poses = self._ego_motion, self._poses
            if _objects_of(settings) == _objects_of(last):
                other._sweeps, other._tracks = self._sweeps, self._tracks
        return other

    def use_threads(self, num_threads: int) -> None:
        """Sets the most threads that registration may use; poses do not depend on it."""
        self._ego_motion.use_threads(num_threads)

    def prepared(self, *sweeps: Sweep) -> list[ObjectSweep]:
        """The sweeps made ready, in the order of the arguments, oldest first.

        Raises:
            SweepError: If too few points of one are left, or if one cannot follow that before it:
                it is older, of another frame, or comes after too long a gap.
        """
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
                f"sweep {sweeps[-2].stamp_ns}: the sweeps of its triplet do not follow each other, "
                f"expected one frame_id, rising stamps and no gap above ego_motion.max_gap_s, "
                f"which is {self._settings.ego_motion.max_gap_s:g}"
            )
        return [self._sweeps[sweep] for sweep in sweeps]

    def start(self, triplet: SweepTriplet) -> Start:
        """Whether the motions of the last triplet help with this one, and if not, why."""
        if not self._settings.warm_start.enabled:
            return Start.COLD_BY_SETTING
        known = self._tracks
        if known is None:
            return Start.COLD_FIRST
        if known.frame_id != triplet.current.frame_id:
            return Start.COLD_FRAME
        elapsed_s = (triplet.current.stamp_ns - known.stamp_ns) / NANOSECONDS
        if elapsed_s < 0:
            return Start.COLD_TIME_JUMP
        return Start.COLD_GAP if elapsed_s > self._settings.warm_start.max_gap_s else Start.WARM

    @property
    def is_blank(self) -> bool:
        """Whether nothing is known of how objects moved."""
        return self._tracks is None

    def past(self, current: ObjectSweep, interval_s: float) -> list[Target]:
        """Older sweeps to test motions on, as far as there are any, the youngest first.

        Args:
            current: The current sweep.
            interval_s: Time to the next sweep.
        """
        if interval_s <= 0:
            return []
        ages: dict[ObjectSweep, float] = {}
        for other, sweep in reversed(self._sweeps.items()):
            age = (current.sweep.stamp_ns - other.stamp_ns) / NANOSECONDS
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

    def follow(
        self,
        current: ObjectSweep,
        movers: ObjectPoints,
        moving: JudgedMotions,
        scores: NDArray[np.float64],
        are_clear: NDArray[np.bool_],
        interval_s: float,
    ) -> tuple[Tracks, NDArray[np.int64]]:
        """Follows what moves into the current sweep.

        Args:
            current: The current sweep.
            movers: K objects that move.
            moving: Their motions.
            scores: (K,) logarithm of the odds that they move.
            are_clear: (K,) whether they are said to move.
            interval_s: Time to the next sweep.

        Returns:
            The tracks, and (K,) the number of the track of each mover.
        """
        seen = Sightings.of(
            movers,
            moving,
            scores,
            are_clear,
            current.pose.world_from_sensor,
            interval_s or USUAL_INTERVAL_S,
        )
        tracks, ids = follow(self._expected_tracks(current, interval_s), seen, self._next_id)
        self._next_id = max(self._next_id, int(ids.max(initial=0)) + 1)
        if self._settings.warm_start.enabled and interval_s > 0:
            self._tracks = tracks
        return tracks, ids[seen.groups]

    def expected(
        self, current: ObjectSweep, objects: ObjectPoints, interval_s: float
    ) -> Expectation:
        """Returns what the tracks say of objects of the current sweep."""
        tracks = self._expected_tracks(current, interval_s)
        return Expectation.of(objects, tracks, current.pose.world_from_sensor, interval_s)

    def _expected_tracks(self, current: ObjectSweep, interval_s: float) -> Tracks:
        """Returns the tracks as they are expected in the current sweep."""
        known, sweep = self._tracks, current.sweep
        if known is not None and interval_s > 0 and self._continues(known, sweep):
            return alive(known, sweep.stamp_ns, interval_s)
        return Tracks.none(sweep.stamp_ns, sweep.frame_id)

    def _continues(self, known: Tracks, sweep: Sweep) -> bool:
        """Returns whether tracks go on until a sweep."""
        elapsed_s = (sweep.stamp_ns - known.stamp_ns) / NANOSECONDS
        is_later = 0 < elapsed_s <= self._settings.warm_start.max_gap_s
        return is_later and known.frame_id == sweep.frame_id

    def _add_pose(self, sweep: Sweep) -> None:
        pose = self._ego_motion.pose_of(sweep)
        if pose.source is EgoSource.START:
            # The map was restarted: earlier poses no longer hold.
            self._poses.clear()
            self._sweeps.clear()
            self._tracks = None
        _keep_last(self._poses, sweep, pose)

    def _add(self, sweep: Sweep) -> None:
        pose = self._poses[sweep]
        if pose.source is EgoSource.START:
            pose = replace(pose, motion=self._ego_motion.motion_in(sweep))
        # Here, not after a whole triplet: there may never be one if every third sweep is refused.
        _keep_last(self._sweeps, sweep, ObjectSweep(sweep, pose, self._settings))


def _objects_of(settings: Settings) -> tuple[object, ...]:
    """The settings that say what an object is."""
    return settings.crop, settings.ground, settings.objects


def _keep_last(items: dict[Sweep, Item], sweep: Sweep, item: Item) -> None:
    """Adds an item and drops those of the oldest sweeps."""
    items[sweep] = item
    while len(items) > _MAX_SWEEPS:
        del items[next(iter(items))]
