# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What settings are worth: a cost, lower is better, and the figures behind it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final, Protocol

from mnsf_ros.evaluation.results import MethodSummary, ResultRow, summarize
from mnsf_ros.evaluation.scoring import failed_row, scored_row
from mnsf_ros.settings import Settings
from mnsf_ros.tuning.halves import METHOD, Half

# Added for the share of examples without a flow, so that settings cannot win by giving up.
FAILURE_COST: Final = 1.0


@dataclass(frozen=True)
class Judgement:
    """What some settings are worth.

    Attributes:
        cost: Lower is better.
        figures: What a figure is, to its value.
    """

    cost: float
    figures: dict[str, float]


class Judge(Protocol):
    """Tries settings on a half of the recordings."""

    @property
    def goal(self) -> str:
        """What the cost is, with its unit."""
        ...

    def __call__(self, settings: Settings) -> Judgement:
        """Estimates all examples and returns what came out."""
        ...


def _three_way(summary: MethodSummary) -> float:
    return summary.three_way_epe_m.get("mean", math.nan)


def _lack_of_iou(summary: MethodSummary) -> float:
    return math.nan if summary.movers is None else 1.0 - summary.movers.iou


# Name of a goal to what it is, and the cost of a summary.
LABELLED_GOALS: Final[dict[str, tuple[str, Callable[[MethodSummary], float]]]] = {
    "epe": ("three-way EPE (m)", _three_way),
    "iou": ("1 - IoU of dynamic points", _lack_of_iou),
}


@dataclass(frozen=True, eq=False)
class LabelledJudge:
    """Judges by the truth, as `mnsf evaluate` scores.

    Attributes:
        half: Examples with truth.
        name: One of `LABELLED_GOALS`.
    """

    half: Half
    name: str

    @property
    def goal(self) -> str:
        """What the cost is, with its unit."""
        return LABELLED_GOALS[self.name][0]

    def __call__(self, settings: Settings) -> Judgement:
        """Estimates and scores all examples."""
        summary = self.summary(settings)
        cost = LABELLED_GOALS[self.name][1](summary)
        failed = summary.num_failed / self.half.num_examples
        movers, errors = summary.movers, summary.errors
        figures = {goal: of(summary) for goal, of in LABELLED_GOALS.values()}
        for group in ("dynamic", "static"):
            if group in errors:
                figures[f"EPE of {group} points (m)"] = errors[group].epe_m
        if movers is not None:
            figures |= {
                "precision of dynamic points": movers.precision,
                "recall of dynamic points": movers.recall,
                "false movers per sweep": movers.ghosts_per_sweep,
            }
        cost = math.inf if math.isnan(cost) else cost + FAILURE_COST * failed
        return Judgement(cost, figures | {"failed share": failed})

    def summary(self, settings: Settings) -> MethodSummary:
        """Returns what `mnsf evaluate` would say of these examples alone."""
        rows: list[ResultRow] = []
        for stretch in self.half.estimated(settings):
            for example, estimate in stretch:
                if estimate is None:
                    rows.append(failed_row(example, METHOD, "no flow"))
                else:
                    rows.append(scored_row(example, METHOD, estimate, estimate.time_ms))
        return summarize(rows)[0]
