# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The three sweeps of one estimate, seen from the middle one."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.objects.attachments import attached
from mnsf_ros.objects.confidence import doubtful_confidence, moving_confidence, standing_confidence
from mnsf_ros.objects.decision import Decision
from mnsf_ros.objects.encoded_field import Heads, encoded, headed
from mnsf_ros.objects.motion_memory import MotionMemory
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.prepared_sweeps import ReadySweeps
from mnsf_ros.objects.splitting import split
from mnsf_ros.objects.target import Targets
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
        tracks: What was followed, as it is expected by now.
        interval_s: Time to the next sweep; 0 without stamps.
        start: Whether anything is known from triplets before.
        min_points: Minimum number of thinned points of an object that is fitted.
    """

    current: ObjectSweep
    targets: Targets
    tracks: list[Track]
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
    ) -> "Scene":
        """Looks at a triplet whose sweeps are ready."""
        start = memory.enter(triplet.stretch)
        *_, current, _ = ready.of_triplet
        near = ready.near(triplet.interval_ratio)
        interval_s = max(0.0, triplet.interval_s)
        past = ready.past(current, interval_s)
        current = split(current, past)
        near, past = ([replace(one, current=current) for one in each] for each in (near, past))
        tracks = memory.expected(current.sweep.stamp_ns, interval_s)
        return cls(current, Targets(near, past), tracks, interval_s, start, settings.min_points)

    @property
    def usual_interval_s(self) -> float:
        """The time to the next sweep in seconds, or its usual value if that is not known."""
        return self.interval_s or USUAL_INTERVAL_S

    def over_ground(
        self,
        decision: Decision,
        heads: Heads,
        tracks: Sequence[Track],
        ids: NDArray[np.int64],
    ) -> OverGround:
        """Spreads the motions of objects over all points of the current sweep.

        Args:
            decision: Which objects move.
            heads: (K, 3, 3) how those K move and turn.
            tracks: What is followed.
            ids: (K,) the numbers of their tracks.
        """
        is_moving, doubtful = decision.is_moving, decision.doubtful
        movers, moving = decision.fitted.objects.only(is_moving), decision.moving.only(is_moving)
        current = self.current
        owners = current.objects()
        rows = movers.rows_of(current.num_objects)[owners]
        are_loose = self._are_loose(doubtful.objects, movers)
        beside, their_rows = attached(current, owners, movers, are_loose)
        rows[beside] = their_rows
        if current.clock is not None:
            velocities = moving.motions[movers.owners] / np.float32(self.usual_interval_s)
            again, their_rows = current.clock.owners_again(
                current.xyz, movers.positions, velocities, movers.owners
            )
            is_free = rows[again] < 0
            rows[again[is_free]] = their_rows[is_free]
        confidence = standing_confidence(current.xyz)
        doubts = np.full(current.num_objects, np.nan, np.float32)
        doubts[doubtful.objects.numbers] = doubtful_confidence(doubtful)
        in_doubt = np.flatnonzero(~np.isnan(doubts)[owners])
        confidence[in_doubt] = doubts[owners[in_doubt]]
        motion = np.zeros((len(rows), 3), np.float32)
        track_ids = np.zeros(len(rows), np.int32)
        is_dynamic = rows >= 0
        own = np.flatnonzero(is_dynamic)
        rows = rows[own]
        offsets = np.take(current.xyz, own, axis=0) - movers.centers[rows]
        motion[own], track_ids[own] = headed(encoded(offsets), rows, heads), ids[rows]
        scores, held = decision.scores[is_moving], decision.held[is_moving]
        confidence[own] = moving_confidence(moving, scores, held)[rows]
        pose = self.targets.near[0].sweep.pose
        if pose.source is EgoSource.CONSTANT_VELOCITY:
            # Without the ego motion, no flow is known.
            confidence[:] = 0
        return OverGround(
            motion=motion,
            dynamic=is_dynamic,
            confidence=confidence,
            world_from_sensor=current.pose.world_from_stamp,
            next_from_current=self.targets.near[0].from_current,
            source=pose.source.value,
            pose_covariance=current.pose.covariance,
            motion_covariance=pose.step_covariance,
            objects=tracked_objects(tracks, current, track_ids),
            track_ids=track_ids,
        )

    def _are_loose(self, doubtful: ObjectPoints, movers: ObjectPoints) -> NDArray[np.bool_]:
        """Returns the mask (all objects,) of those that are doubtful or too small to be fitted.

        A whole that stands while a part of it moves is neither.
        """
        wholes = self.current.wholes
        are_loose = (self.current.counts < self.min_points)[wholes]
        are_loose[doubtful.numbers] = True
        are_loose[wholes[movers.numbers]] = False
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
