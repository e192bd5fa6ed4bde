# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What one estimate keeps for the next: the tracks of what moves."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import Start
from mnsf_ros.objects.expectation import Expectation
from mnsf_ros.objects.following import alive, follow
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.sightings import Sightings
from mnsf_ros.objects.tracks import Tracks
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S, Sweep, SweepTriplet


class MotionMemory:
    """Remembers what moved, as long as time goes on and the frame and the world are the same."""

    def __init__(self, settings: Settings) -> None:
        self._settings = settings
        self._world = 0
        self._tracks: Tracks | None = None
        self._next_id = 1

    def with_settings(self, settings: Settings, *, is_same_world: bool) -> MotionMemory:
        """Returns a memory for other settings.

        It knows what this one does if objects and the world that they are in stay the same.
        """
        other = MotionMemory(settings)
        other._next_id, other._world = self._next_id, self._world
        if is_same_world:
            other._tracks = self._tracks
        return other

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

    def enter(self, world: int) -> None:
        """Forgets what is known of another world than that of the sweeps at hand."""
        if world != self._world:
            self._world, self._tracks = world, None

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
