# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Why objects of one estimate were called dynamic or not."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import Reason, Verdict
from mnsf_ros.objects.decision import Decision
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.settings import ObjectSettings


@dataclass(frozen=True, eq=False)
class Reasons:
    """Evidence of an estimate for and against its objects, by point.

    Attributes:
        current: The sweep.
        settings: Of the objects.
        decision: What was decided about its objects.
    """

    current: ObjectSweep
    settings: ObjectSettings
    decision: Decision

    def __call__(self, rows: NDArray[np.int64]) -> Reason:
        """Returns the verdict on the object that owns most of these rows of the sweep."""
        owners = self.current.objects()[rows]
        number = int(np.bincount(owners[owners > 0]).argmax()) if (owners > 0).any() else 0
        if number == 0:
            return Reason(Verdict.NO_OBJECT)
        points = self.current.thinned[self.current.thinned_objects == number]
        size_m = float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0
        found = np.flatnonzero(self.decision.searched.objects.numbers == number)
        if len(found) == 0:
            return Reason(self._before_search(number, len(points)), len(points), size_m)
        reason = Reason(
            Verdict.NO_BETTER_MOTION,
            len(points),
            size_m,
            static_m=_residuals(self.decision.searched.standing, found[0]),
            start=self.decision.start[found[0]].astype(np.float64),
        )
        found = np.flatnonzero(self.decision.fitted.objects.numbers == number)
        return self._of_fitted(reason, found[0]) if len(found) else reason

    def _of_fitted(self, reason: Reason, row: int) -> Reason:
        return replace(
            reason,
            verdict=Verdict.DYNAMIC if self.decision.is_moving[row] else Verdict.REFUSED,
            moving_m=_residuals(self.decision.moving, row),
            motion=self.decision.moving.motions[row].astype(np.float64),
            evidence={
                "free space": float(self.decision.seen.free[row]),
                "probability": float(1 / (1 + np.exp(-self.decision.scores[row]))),
            },
        )

    def _before_search(self, number: int, num_points: int) -> Verdict:
        if num_points < self.settings.min_points:
            return Verdict.TOO_FEW_POINTS
        if number in self.decision.suspects.objects.numbers:
            return Verdict.LEFT_OUT
        may_move = self.current.may_move[number]
        return Verdict.NOT_SUSPECTED if may_move else Verdict.TOO_LARGE


def _residuals(motions: JudgedMotions, row: int) -> dict[str, float]:
    """Name of each other sweep to its residual, metres."""
    older = [f"{number} before" for number in range(2, 2 + motions.past.shape[1])]
    names = (*("next", "previous")[: motions.near.shape[1]], *older)
    values = (*motions.near[row].tolist(), *motions.past[row].tolist())
    return dict(zip(names, values, strict=True))
