# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Cost of settings on recordings with true flow, as `mnsf evaluate` scores."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import pandas as pd

from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.scoring import failed_row, scored_row
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.settings import Settings
from mnsf_ros.tuning.halves import METHOD, Half

# Added for the share of examples without a flow, so that settings cannot win by failing.
FAILURE_COST: Final = 1.0


@dataclass(frozen=True)
class Judgement:
    """Cost of some settings.

    Attributes:
        cost: Lower is better.
        figures: Name, with unit, to value of the figures behind it.
    """

    cost: float
    figures: dict[str, float]


def _three_way(summary: pd.Series) -> float:
    return float(summary.get("three_way.mean", math.nan))


def _lack_of_iou(summary: pd.Series) -> float:
    return 1.0 - float(summary.get("movers.iou", math.nan))


# Name of a goal to the name of its cost, and the cost of a summary.
LABELLED_GOALS: Final[dict[str, tuple[str, Callable[[pd.Series], float]]]] = {
    "epe": ("three-way EPE (m)", _three_way),
    "iou": ("1 - IoU of dynamic points", _lack_of_iou),
}
# Names of further figures to columns of the summary.
_FIGURES: Final = {
    "EPE of dynamic points (m)": "errors.dynamic.epe_m",
    "EPE of static points (m)": "errors.static.epe_m",
    "precision of dynamic points": "movers.precision",
    "recall of dynamic points": "movers.recall",
    "false movers per sweep": "movers.ghosts_per_sweep",
}


class LabelledJudge:
    """Judges settings by the true flow."""

    def __init__(self, half: Half, name: str) -> None:
        """Judges by one of `LABELLED_GOALS`, on examples with true flow."""
        self._half = half
        self.goal, self._cost_of = LABELLED_GOALS[name]

    def __call__(self, settings: Settings) -> Judgement:
        """Estimates and scores all examples."""
        summary = self.summary(settings)
        failed = float(summary["num_failed"]) / self._half.num_examples
        figures = {goal: of(summary) for goal, of in LABELLED_GOALS.values()}
        figures |= {name: float(summary[key]) for name, key in _FIGURES.items() if key in summary}
        cost = self._cost_of(summary)
        cost = math.inf if math.isnan(cost) else cost + FAILURE_COST * failed
        return Judgement(cost, figures | {"failed share": failed})

    def summary(self, settings: Settings) -> pd.Series:
        """Returns the summary that `mnsf evaluate` would give of these examples alone."""
        rows: list[ResultRow] = []
        for stretch in self._half.estimated(settings):
            for example, estimate in stretch:
                if estimate is None:
                    rows.append(failed_row(example, METHOD, "no flow"))
                else:
                    rows.append(scored_row(example, METHOD, estimate, estimate.time_ms))
        return summarize(rows).loc[METHOD]
