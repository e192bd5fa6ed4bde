"""What the rows of `paper_table.py` say of a method: means over moments and seeds."""

from __future__ import annotations

import statistics
from collections.abc import Iterable
from dataclasses import dataclass

from kitti_examples import MOMENTS

from mnsf_ros.evaluation.metrics import FlowErrors, mean_of
from mnsf_ros.evaluation.results import ResultRow

PARTS = ("all", "dynamic", "static")

# Rows that are the same estimate under the name that a table needs.
SAME_AS = {
    "mnsf-mlp": "mnsf",
    "mnsf-depth3": "mnsf",
    "mnsf-frames3": "mnsf",
    "mnsf-frames2": "mnsf-no-backward",
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
