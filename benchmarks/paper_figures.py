# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the rows of `paper_table.py` say of a method: means over moments and seeds.

And what the authors' own released code makes of the four triplets of 8,192 points: their solvers
and the settings of their README, one seed, with an exact distance transform and an exact k-d tree
in place of their approximations. Means over the triplets; dynamic and static over labelled points.
Runs differ by several points of Acc5 from seed to seed.
"""

from __future__ import annotations

import statistics
from collections.abc import Iterable, Mapping
from dataclasses import dataclass

from kitti_examples import MOMENTS

from mnsf_ros.evaluation.metrics import FlowErrors, mean_of
from mnsf_ros.evaluation.results import ResultRow

PARTS = ("all", "dynamic", "static")

# Rows that are the same estimate under the name that a table needs.
SAME_AS = {
    "mnsf+fusion.kind=mlp": "mnsf",
    "mnsf+fusion.num_hidden_layers=3": "mnsf",
}


EPE, ACC5, DYNAMIC, STATIC = "EPE (m)", "Acc5 (%)", "EPE dynamic", "EPE static"
DECIMALS = {EPE: 3, ACC5: 1, DYNAMIC: 3, STATIC: 3}

AUTHORS: Mapping[str, Mapping[str, float]] = {
    "nsfp": {EPE: 0.071, ACC5: 50.7, DYNAMIC: 0.297, STATIC: 0.073},
    "fnsf": {EPE: 0.066, ACC5: 54.5, DYNAMIC: 0.370, STATIC: 0.050},
    "mnsf": {EPE: 0.087, ACC5: 51.5, DYNAMIC: 0.285, STATIC: 0.073},
}


@dataclass(frozen=True)
class Measured:
    """What is known of one method at one scale.

    Attributes:
        errors: Part to the mean over moments and seeds.
        of_seeds: Part to the mean over moments, for each seed that has all of them.
        time_ms: Mean wall time of an estimate.
    """

    errors: dict[str, FlowErrors]
    of_seeds: dict[str, list[FlowErrors]]
    time_ms: float

    @property
    def num_seeds(self) -> int:
        """How many seeds have all moments."""
        return len(self.of_seeds["all"])


def measured_of(rows: Iterable[ResultRow], scale: str, method: str) -> Measured | None:
    """Summarizes the seeds that have all moments; None if there is no such seed."""
    found: dict[str, dict[int, ResultRow]] = {}
    for row in rows:
        is_scored = row.method == SAME_AS.get(method, method) and not row.failure
        if is_scored and row.recording.split()[0] == scale:
            found.setdefault(row.recording, {})[row.number] = row
    seeds = [list(seed.values()) for seed in found.values() if len(seed) == len(MOMENTS)]
    if not seeds:
        return None
    of_seeds = {
        part: [mean_of(row.errors[part] for row in seed) for seed in seeds] for part in PARTS
    }
    return Measured(
        {part: mean_of(values) for part, values in of_seeds.items()},
        of_seeds,
        statistics.fmean(row.time_ms for seed in seeds for row in seed),
    )


def verdict(
    authors: Mapping[str, float], ours: Mapping[str, float], spreads: Mapping[str, float]
) -> str:
    """Says whether our figures are no worse, and if they are, in what and by how much.

    Args:
        authors: Column to the authors' figure, of one seed.
        ours: Column to our mean over seeds.
        spreads: Column to the standard deviation of ours from seed to seed, NaN if unknown. What
            is worse by less than that could be another seed of theirs.
    """
    within, worse = [], []
    for column, theirs in authors.items():
        lost = theirs - ours[column] if column == ACC5 else ours[column] - theirs
        # Their figures are rounded; a difference of less than half a digit is none.
        if lost >= 0.5 * 10.0 ** -DECIMALS[column]:
            text = f"{column.split(' (')[0]} by {lost:.{DECIMALS[column]}f}"
            (within if lost <= spreads[column] else worse).append(text)
    if worse:
        return f"worse in {', '.join(worse)}"
    return f"no worse, within the seeds ({', '.join(within)})" if within else "no worse"
