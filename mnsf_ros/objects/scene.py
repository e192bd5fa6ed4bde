# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The three sweeps of one estimate, seen from the middle one."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.objects.attachments import attached
from mnsf_ros.objects.confidence import (
    doubtful_confidence,
    moving_confidence,
    standing_confidence,
)
from mnsf_ros.objects.motion_fusion import JudgedMotions, Targets
from mnsf_ros.objects.motion_memory import MotionMemory
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.prepared_sweeps import ReadySweeps
from mnsf_ros.objects.splitting import split
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.tracked_objects import tracked_objects
from mnsf_ros.objects.tracks import Track
from mnsf_ros.settings import ObjectSettings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S, Start, SweepTriplet


@dataclass(frozen=True, eq=False)
class Scene:
    """Input of one estimate: the current sweep and its targets.

    Attributes:
        current: The middle sweep.
        targets: What its objects are measured on.
        interval_s: Time to the next sweep; 0 without stamps.
        start: Whether anything is known from triplets before.
        min_points: Minimum number of thinned points of an object that is fitted.
    """

    current: ObjectSweep
    targets: Targets
    interval_s: float
    start: Start
    min_points: int

    @classmethod
    def of(
        cls,
        triplet: SweepTriplet,
        ready: ReadySweeps,
        memory: MotionMemory,
        settings: ObjectSettings,
    ) -> Scene:
        """Looks at a triplet whose sweeps are ready."""
        start = memory.enter(triplet.stretch)
        *_, current, _ = ready.of_triplet
        near = ready.near(triplet.interval_ratio)
        interval_s = max(0.0, triplet.interval_s)
        past = ready.past(current, interval_s)
        current = split(current, past)
        return cls(current, Targets(near, past), interval_s, start, settings.min_points)

    @property
    def usual_interval_s(self) -> float:
        """The time to the next sweep in seconds, or its usual value if that is not known."""
        return self.interval_s or USUAL_INTERVAL_S

    def over_ground(
        self,
        movers: Suspects,
        moving: JudgedMotions,
        doubtful: Suspects,
        scores: NDArray[np.float64],
        tracks: Sequence[Track],
        ids: NDArray[np.int64],
    ) -> OverGround:
        """Spreads the motions of objects over all points of the current sweep.

        Args:
            movers: Objects that move.
            moving: Their motions.
            doubtful: Objects that neither motion nor being static explains well enough, or that
                were left out.
            scores: (K,) logarithm of the odds that the movers move.
            tracks: What is followed.
            ids: (K,) the numbers of the tracks of K movers.
        """
        current = self.current
        owners = current.objects()
        points = movers.objects
        rows = points.rows_of(current.num_objects)[owners]
        beside, their_rows = attached(current, owners, points, self._are_loose(doubtful.objects))
        rows[beside] = their_rows
        if current.clock is not None:
            velocities = moving.motions[points.owners] / np.float32(self.usual_interval_s)
            again, their_rows = current.clock.owners_again(
                current.xyz, points.positions, velocities, points.owners
            )
            is_free = rows[again] < 0
            rows[again[is_free]] = their_rows[is_free]
        confidence = standing_confidence(current.xyz)
        doubts = np.full(current.num_objects, -1, np.float32)
        doubts[doubtful.objects.numbers] = doubtful_confidence(doubtful)
        motion, is_moving, track_ids = _spread(
            rows,
            owners,
            np.ascontiguousarray(moving.motions),
            moving_confidence(movers, moving, scores, self.targets),
            ids.astype(np.int32),
            doubts,
            confidence,
        )
        pose = self.targets.near[0].sweep.pose
        if pose.source is EgoSource.CONSTANT_VELOCITY:
            # Without the ego motion, no flow is known.
            confidence[:] = 0
        return OverGround(
            motion=motion,
            dynamic=is_moving,
            confidence=confidence,
            world_from_sensor=current.pose.world_from_stamp,
            next_from_current=self.targets.near[0].from_current,
            source=pose.source.value,
            pose_covariance=current.pose.covariance,
            motion_covariance=pose.step_covariance,
            objects=tracked_objects(tracks, current, track_ids),
            track_ids=track_ids,
        )

    def _are_loose(self, doubtful: ObjectPoints) -> NDArray[np.bool_]:
        """Returns the mask (all objects,) of those that are doubtful or too small to be fitted."""
        current = self.current
        counts = np.bincount(current.thinned_objects, minlength=current.num_objects)
        are_loose = counts < self.min_points
        are_loose[doubtful.numbers] = True
        are_loose[0] = False
        return are_loose

    def flow(self, over_ground: OverGround) -> NDArray[np.float32]:
        """(N, 3) metres, the flow of all points: motion over ground, then that of the sensor."""
        sweep, pose = self.current.sweep, self.current.pose
        xyz, motion = sweep.xyz, over_ground.next_from_current
        # (R - I) p + t, not (R p + t) - p: far from the origin the difference would lose digits.
        flow = transformed(xyz, motion - np.diag((1.0, 1.0, 1.0, 0.0)))
        moving = np.flatnonzero(over_ground.dynamic)
        over_ground_motion = over_ground.motion[moving]
        if pose.motion is not None and sweep.times_s is not None:
            over_ground_motion = pose.motion.turned_back(over_ground_motion, sweep.times_s[moving])
        flow[moving] += turned(over_ground_motion, motion[:3, :3])
        return flow


@compiled(
    "Tuple((float32[:, ::1], boolean[::1], int32[::1]))(int64[::1], int64[::1], float32[:, ::1], "
    "float32[::1], int32[::1], float32[::1], float32[::1])"
)
def _spread(
    rows: NDArray[np.int64],
    owners: NDArray[np.int64],
    motions: NDArray[np.float32],
    confidences: NDArray[np.float32],
    ids: NDArray[np.int32],
    doubts: NDArray[np.float32],
    confidence: NDArray[np.float32],
) -> tuple[NDArray[np.float32], NDArray[np.bool_], NDArray[np.int32]]:
    """Returns motion, dynamic flag, and track number of each of N points.

    Args:
        rows: (N,) the mover of each point; -1 for none.
        owners: (N,) the object of each point.
        motions: (K, 3) those of the movers.
        confidences: (K,) those of the movers.
        ids: (K,) the numbers of the movers' tracks.
        doubts: (all objects,) the confidence in objects that may move; -1 for all others.
        confidence: (N,) as if all were static; changed where it is another.
    """
    motion = np.zeros((len(rows), 3), np.float32)
    is_moving = np.zeros(len(rows), np.bool_)
    track_ids = np.zeros(len(rows), np.int32)
    for point in range(len(rows)):
        row = rows[point]
        if row >= 0:
            for axis in range(3):
                motion[point, axis] = motions[row, axis]
            is_moving[point] = True
            track_ids[point] = ids[row]
            confidence[point] = confidences[row]
        elif doubts[owners[point]] >= 0:
            confidence[point] = doubts[owners[point]]
    return motion, is_moving, track_ids
