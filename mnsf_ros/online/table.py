# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The table of objects of the current sweep: what each stage of an estimate found."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats, Floats32, Ints
from mnsf_ros.core.reason import Verdict
from mnsf_ros.online.motions import JudgedMotions, TrackPrior
from mnsf_ros.online.object_points import ObjectPoints, Rows
from mnsf_ros.online.target import Targets

# Columns of the evidence for and against a motion.
NUM_FEATURES: Final = 8
# Verdicts on objects whose motion was fitted.
FITTED: Final = (Verdict.DYNAMIC, Verdict.REFUSED, Verdict.PARTLY)


@dataclass(frozen=True, eq=False)
class ObjectTable(Rows):
    """K objects that are neither too small nor too large to move, a row each.

    Each stage fills columns of the objects that are still open, and writes the verdict on those
    that it rejects. The gate leaves none open.

    Attributes:
        points: Their points, and their numbers in the sweep.
        wholes: (K,) the object that each was cut out of, else its own number.
        verdicts: (K,) of `Verdict`.
        prior: What their tracks predict.
        static: Residuals as static objects, from a few points of each; for suspects only.
        first_guess: (K, 3) metres to the next sweep, initial value of the fit of the motion.
        fitted: The fitted motion and its residuals.
        num_new_or_gone: (K,) points new or gone, see `free_space`.
        evidence: (K, E) features for and against the motion.
        log_odds: (K,) that it moves.
        residual_rise: (K,) metres, rise of the residual for shifted motions, see `residual_rise_m`.
        groups: (K,) the group of objects that move, or may move, alike; else -1.
        linear_motions: (K, 3, 3) motion and turn of movers, see `turning.LinearMotions`.
        track_ids: (K,) the track of objects in groups, else 0.
    """

    points: ObjectPoints
    wholes: Ints
    verdicts: NDArray[np.object_]
    prior: TrackPrior
    static: JudgedMotions
    first_guess: Floats32
    fitted: JudgedMotions
    num_new_or_gone: Floats
    evidence: Floats
    log_odds: Floats
    residual_rise: Floats
    groups: Ints
    linear_motions: Floats
    track_ids: Ints

    @classmethod
    def begun(
        cls, points: ObjectPoints, wholes: Ints, prior: TrackPrior, targets: Targets
    ) -> "ObjectTable":
        """Returns the table before any stage: all objects are open."""
        num_objects = len(points)
        unknown = JudgedMotions(
            np.zeros((num_objects, 3), np.float32),
            np.full((num_objects, len(targets.near)), np.nan),
            np.full((num_objects, len(targets.past)), np.nan),
        )
        return cls(
            points=points,
            wholes=wholes,
            verdicts=np.full(num_objects, Verdict.OPEN, object),
            prior=prior,
            static=unknown,
            first_guess=unknown.motions,
            fitted=unknown,
            num_new_or_gone=np.zeros(num_objects),
            evidence=np.zeros((num_objects, NUM_FEATURES)),
            log_odds=np.zeros(num_objects),
            residual_rise=np.zeros(num_objects),
            groups=np.full(num_objects, -1),
            linear_motions=np.zeros((num_objects, 3, 3)),
            track_ids=np.zeros(num_objects, np.int64),
        )

    def __len__(self) -> int:
        return len(self.points)

    def rejected(self, rows: Ints, verdict: Verdict) -> "ObjectTable":
        """Returns the table with a verdict on some objects."""
        return self.put(rows, verdicts=verdict)

    @property
    def open_rows(self) -> Ints:
        """Rows of the objects that no stage has decided yet."""
        return np.flatnonzero(self.verdicts == Verdict.OPEN)

    @property
    def mover_rows(self) -> Ints:
        """Rows of the objects that move."""
        return np.flatnonzero(self.verdicts == Verdict.DYNAMIC)

    @property
    def followed_rows(self) -> Ints:
        """Rows of the objects that move, or may move."""
        return np.flatnonzero(self.groups >= 0)

    @cached_property
    def movers(self) -> "ObjectTable":
        """The objects that move."""
        return self.select(self.mover_rows)

    @cached_property
    def doubtful(self) -> "ObjectTable":
        """The suspects that were not found to move, with those beyond the limit of the work."""
        is_certain = self.verdicts == Verdict.NOT_SUSPECTED
        return self.select(np.flatnonzero((self.verdicts != Verdict.DYNAMIC) & ~is_certain))

    def with_tracks(self, track_ids: Ints) -> "ObjectTable":
        """Returns the table with the `track_id` (G,) of each group."""
        rows = self.followed_rows
        return self.put(rows, track_ids=track_ids[self.groups[rows]])

    @property
    def num_groups(self) -> int:
        """Number of groups of objects that move, or may move, alike."""
        return int(self.groups.max(initial=-1)) + 1

    @property
    def group_motions(self) -> Floats:
        """(G, 3) metres, the mean motions of the groups' points to the next sweep."""
        rows, num_groups = self.followed_rows, self.num_groups
        groups, counts = self.groups[rows], self.points.counts[rows].astype(np.float64)
        weights = np.bincount(groups, counts, num_groups)[:, None]
        weighted = self.fitted.motions[rows] * counts[:, None]
        return np.asarray(sums_by_group(weighted, groups, num_groups) / weights, np.float64)


def sums_by_group(values: NDArray[Any], groups: Ints, num_groups: int) -> Floats:
    """Returns (num_groups, 3) the sums of the values (M, 3) of each group (M,)."""
    columns = [np.bincount(groups, values[:, axis], num_groups) for axis in range(3)]
    return np.stack(columns, axis=1)
