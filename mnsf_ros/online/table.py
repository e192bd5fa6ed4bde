# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The table of objects of the current sweep: what each stage of an estimate found."""

from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import Verdict
from mnsf_ros.online.expectation import Expectation
from mnsf_ros.online.motions import JudgedMotions
from mnsf_ros.online.object_points import ObjectPoints, Rows
from mnsf_ros.online.preparation import Scene

# Columns of the evidence for and against a motion.
NUM_FEATURES: Final = 8
# Verdicts on objects whose motion was fitted.
FITTED: Final = (Verdict.DYNAMIC, Verdict.REFUSED, Verdict.PARTLY)


@dataclass(frozen=True, eq=False)
class ObjectTable(Rows):
    """K objects that are neither too small nor too large to move, a row each.

    Each stage fills columns of some objects, and sets the verdict of those that it rejects. An
    object that no stage rejects is dynamic.

    Attributes:
        points: Their points, and their numbers in the sweep.
        wholes: (K,) the object that each was cut out of, else its own number.
        verdicts: (K,) of `Verdict`.
        expected: Predictions of their tracks.
        standing: Residuals as static objects, from a few points of each; for suspects only.
        start: (K, 3) metres to the next sweep, initial value of the fit of the motion.
        moving: The estimated motion and its residuals.
        free: (K,) points new or gone, see `free_space`.
        evidence: (K, E) features for and against the motion.
        scores: (K,) logarithm of the odds that it moves.
        residual_rise: (K,) metres, rise of the residual for shifted motions, see `residual_rise_m`.
        groups: (K,) the group of objects that move, or may move, alike; else -1.
    """

    points: ObjectPoints
    wholes: NDArray[np.int64]
    verdicts: NDArray[np.object_]
    expected: Expectation
    standing: JudgedMotions
    start: NDArray[np.float32]
    moving: JudgedMotions
    free: NDArray[np.float64]
    evidence: NDArray[np.float64]
    scores: NDArray[np.float64]
    residual_rise: NDArray[np.float64]
    groups: NDArray[np.int64]

    @classmethod
    def of(cls, scene: Scene) -> "ObjectTable":
        """Returns the table of the current sweep, before any stage."""
        current = scene.current
        points = ObjectPoints.of(current, scene.settings)
        pose = current.pose.world_from_sensor
        expected = Expectation.of(points, scene.tracks, pose, scene.interval_s)
        num_sweeps = len(scene.targets.near), len(scene.targets.past)
        return cls.begun(points, current.wholes[points.numbers], expected, *num_sweeps)

    @classmethod
    def begun(
        cls,
        points: ObjectPoints,
        wholes: NDArray[np.int64],
        expected: Expectation,
        num_near: int,
        num_past: int,
    ) -> "ObjectTable":
        """Returns a table of objects for some near and past targets, before any stage."""
        number = len(points)
        unknown = JudgedMotions(
            np.zeros((number, 3), np.float32),
            np.full((number, num_near), np.nan),
            np.full((number, num_past), np.nan),
        )
        return cls(
            points=points,
            wholes=wholes,
            verdicts=np.full(number, Verdict.DYNAMIC, object),
            expected=expected,
            standing=unknown,
            start=unknown.motions,
            moving=unknown,
            free=np.zeros(number),
            evidence=np.zeros((number, NUM_FEATURES)),
            scores=np.zeros(number),
            residual_rise=np.zeros(number),
            groups=np.full(number, -1),
        )

    def __len__(self) -> int:
        return len(self.points)

    @property
    def open_rows(self) -> NDArray[np.int64]:
        """Rows of the objects that no stage has rejected yet."""
        return np.flatnonzero(self.verdicts == Verdict.DYNAMIC)

    def rejected(self, rows: NDArray[np.int64], verdict: Verdict) -> "ObjectTable":
        """Returns the table with a verdict on some objects."""
        return self.put(rows, verdicts=verdict)

    @cached_property
    def movers(self) -> "ObjectTable":
        """The objects that move."""
        return self.take(self.open_rows)

    @property
    def doubtful(self) -> "ObjectTable":
        """The suspects that were not found to move, with those beyond the limit of the work."""
        is_open = self.verdicts == Verdict.DYNAMIC
        is_known = self.verdicts == Verdict.NOT_SUSPECTED
        return self.take(np.flatnonzero(~is_open & ~is_known))
