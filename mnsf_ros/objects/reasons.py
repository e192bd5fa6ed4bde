"""Why objects of one estimate were called dynamic or not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.reason import Reason, Verdict
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.settings import ObjectSettings


@dataclass(frozen=True, eq=False)
class Reasons:
    """What an estimate knew of its objects; asked by calling it with points.

    Attributes:
        current: The sweep.
        settings: Of the objects.
        suspected: Objects that no other sweep supports as static.
        judged: The K of them whose motion was searched.
        standing: How well these are explained as static.
        start: (K, 3) where the fits of their motions started.
        moving: The motions that were found.
        is_moving: (K,) what the gate said.
        evidence: Name of what else the gate looked at, to (K,) values.
    """

    current: ObjectSweep
    settings: ObjectSettings
    suspected: ObjectPoints
    judged: ObjectPoints
    standing: JudgedMotions
    start: NDArray[np.float32]
    moving: JudgedMotions
    is_moving: NDArray[np.bool_]
    evidence: Mapping[str, NDArray[np.float64]]

    def __call__(self, rows: NDArray[np.int64]) -> Reason:
        """Returns what became of the object that most of these rows of the sweep belong to."""
        owners = self.current.objects()[rows]
        number = int(np.bincount(owners[owners > 0]).argmax()) if (owners > 0).any() else 0
        if number == 0:
            return Reason(Verdict.NO_OBJECT)
        points = self.current.thinned[self.current.thinned_objects == number]
        size_m = float(np.ptp(points[:, :2], axis=0).max()) if len(points) else 0.0
        found = np.flatnonzero(self.judged.numbers == number)
        if len(found) == 0:
            return Reason(self._before_search(number, len(points), size_m), len(points), size_m)
        k = found[0]
        return Reason(
            Verdict.DYNAMIC if self.is_moving[k] else Verdict.REFUSED,
            len(points),
            size_m,
            _residuals(self.standing, k),
            _residuals(self.moving, k),
            self.start[k].astype(np.float64),
            self.moving.motions[k].astype(np.float64),
            {name: float(values[k]) for name, values in self.evidence.items()},
        )

    def _before_search(self, number: int, num_points: int, size_m: float) -> Verdict:
        if num_points < self.settings.min_points:
            return Verdict.TOO_FEW_POINTS
        if number in self.suspected.numbers:
            return Verdict.LEFT_OUT
        is_too_large = size_m >= self.settings.max_size_m
        return Verdict.TOO_LARGE if is_too_large else Verdict.NOT_SUSPECTED


def _residuals(motions: JudgedMotions, row: int) -> dict[str, float]:
    """Name of each other sweep to what it leaves unexplained, metres."""
    older = [f"{number} before" for number in range(2, 2 + motions.past.shape[1])]
    names = (*("next", "previous")[: motions.near.shape[1]], *older)
    values = (*motions.near[row].tolist(), *motions.past[row].tolist())
    return dict(zip(names, values, strict=True))
