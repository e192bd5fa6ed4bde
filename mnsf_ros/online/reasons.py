# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Why objects of one estimate were called dynamic or not."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import expit

from mnsf_ros.arrays import Floats32, Ints
from mnsf_ros.core.reason import Leader, Match, PointState, Reason, SweepTerms, Verdict
from mnsf_ros.geometry.point_grid import REACH_M
from mnsf_ros.geometry.rigid_motion import transformed
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.table import FITTED, ObjectTable
from mnsf_ros.online.target import Target
from mnsf_ros.sweeps.sweep import NANOSECONDS

# Points of another sweep within this distance of the box of an object are part of its reasons.
_AROUND_M: Final = 2.0
# Verdicts on points of no object, by the numbers of `_without_object`.
_WITHOUT_OBJECT: Final = (
    Verdict.NO_OBJECT,
    Verdict.GROUND,
    Verdict.OUTSIDE_CROP,
    Verdict.TOO_HIGH,
)


@dataclass(frozen=True, eq=False)
class Reasons:
    """Evidence of an estimate for and against its objects, by point; computed when asked.

    Attributes:
        scene: The sweeps.
        table: What the stages found about the objects of the current sweep.
    """

    scene: Scene
    table: ObjectTable

    def __call__(self, rows: Ints) -> Reason:
        """Returns the verdict on the object that owns most of these rows of the sweep."""
        current = self.scene.current
        if 2 * np.count_nonzero(current.own[rows]) > len(rows):
            return Reason(Verdict.OWN_BODY)
        if 2 * np.count_nonzero(current.ceiling[rows]) > len(rows):
            return Reason(Verdict.CEILING)
        objects = current.object_ids()[rows]
        number = int(np.bincount(objects[objects > 0]).argmax()) if (objects > 0).any() else 0
        if number == 0:
            return Reason(self._without_object(rows))
        num_points = int(current.counts[number])
        found = np.flatnonzero(self.table.points.numbers == number)
        row = int(found[0]) if len(found) else -1
        verdict = self._without_row(number, num_points) if row < 0 else self.table.verdicts[row]
        motion, start, leader = None, None, None
        evidence: dict[str, float] = {}
        if verdict in (*FITTED, Verdict.NO_BETTER_MOTION):
            start = self.table.first_guess[row].astype(np.float64)
        if verdict in FITTED:
            motion = self.table.fitted.motions[row]
            if self.table.wholes[row] == number:
                # Of parts it is no evidence: it defined them.
                evidence["points new or gone"] = float(self.table.num_new_or_gone[row])
            evidence["probability"] = float(expit(self.table.log_odds[row]))
            leader = self._leader(row)
        return Reason(
            verdict,
            num_points,
            float(current.sizes[number]),
            sweeps=self._terms(number, motion),
            start=start,
            motion=None if motion is None else motion.astype(np.float64),
            evidence=evidence,
            leader=leader,
        )

    def _without_object(self, rows: Ints) -> Verdict:
        """The verdict on most of these points, which are in no object."""
        current = self.scene.current
        heights, is_low = current.heights[rows], ~current.kept[rows]
        numbers = np.select([np.isneginf(heights), np.isnan(heights), is_low], [3, 2, 1], 0)
        return _WITHOUT_OBJECT[int(np.bincount(numbers, minlength=1).argmax())]

    def _leader(self, row: int) -> Leader | None:
        """What the object of a row goes along with; None if it is static or moves by itself."""
        groups, log_odds = self.table.groups, self.table.log_odds
        limit = self.scene.settings.min_probability
        if self.table.verdicts[row] is not Verdict.DYNAMIC or expit(log_odds[row]) > limit:
            return None
        group = np.flatnonzero(groups == groups[row])
        best = int(group[log_odds[group].argmax()])
        return Leader(self.table.points.centers[best], float(expit(log_odds[best])))

    def _without_row(self, number: int, num_points: int) -> Verdict:
        """The verdict on an object that is not in the table."""
        if num_points < self.scene.settings.min_points:
            return Verdict.TOO_FEW_POINTS
        is_short_enough = self.scene.current.is_short_enough[number]
        return Verdict.NOT_SUSPECTED if is_short_enough else Verdict.TOO_LARGE

    def _terms(self, number: int, motion: Floats32 | None) -> tuple[SweepTerms, ...]:
        """The terms of all targets for an object with a motion (3,), metres to the next sweep."""
        objects = ObjectPoints.of(self.scene.current, self.scene.settings)
        own = objects.select(np.flatnonzero(objects.numbers == number))
        if len(own) == 0:
            return ()
        no_motion = np.zeros(3, np.float32)
        return tuple(
            SweepTerms(
                age_s=_age_s(target),
                points=_points_around(own, target),
                static=_match(own, target, no_motion),
                moving=None if motion is None else _match(own, target, motion),
            )
            for target in (*self.scene.targets.near, *self.scene.targets.past)
        )


def _age_s(target: Target) -> float:
    return (target.sweep.stamp_ns - target.current.stamp_ns) / NANOSECONDS


def _points_around(objects: ObjectPoints, target: Target) -> Floats32:
    """Points (Q, 3) of the target, metres, current frame, around the box of the only object."""
    points = transformed(target.sweep.thinned, target.to_current)
    low, high = objects.positions.min(axis=0), objects.positions.max(axis=0)
    is_near = ((points >= low - _AROUND_M) & (points <= high + _AROUND_M)).all(axis=1)
    return np.asarray(points[is_near], np.float32)


def _match(objects: ObjectPoints, target: Target, motion: Floats32) -> Match:
    """Compares the only object, moved by (3,) metres to the next sweep, with a target."""
    positions = objects.positions + target.displacements(objects, motion[None])
    places = transformed(positions, target.from_current)
    nearest = target.sweep.grid.nearest(places)
    distances = np.linalg.norm(target.sweep.thinned[nearest] - places, axis=1)
    beyond = np.where(nearest >= 0, distances, REACH_M) - objects.spacing
    states = np.select(
        [beyond <= 0, target.sweep.view.are_free(places), target.are_unseen(places)],
        [PointState.HIT, PointState.FREE, PointState.HIDDEN],
        PointState.UNCLEAR,
    )
    residual_m = float(target.residuals(objects, motion[None])[0])
    return Match(positions, states.astype(np.uint8), residual_m)
