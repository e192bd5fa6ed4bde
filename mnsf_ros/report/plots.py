# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The plots of the report: errors by range and by speed, precision and recall, time per stage."""

import math
from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.drawing.svg import dot_chart
from mnsf_ros.evaluation.summary import groups_in, part_of

# Part of the summary to title, and unit of its limits.
_BINS: Final = {"by_range": ("EPE by range", "m"), "by_speed": ("EPE by true speed", "m/s")}
_STAGES: Final = "stage_times_ms"
_CALLED: Final = {"precision": "precision", "recall": "recall", "iou": "IoU"}


class Plot(NamedTuple):
    """A plot with a colour for each method."""

    title: str
    svg: str


def plots_of(summary: pd.DataFrame) -> Iterator[Plot]:
    """Yields the plots of a summary with a line for each method, those that have values."""
    methods = [str(name) for name in summary.index]
    for field, (title, unit) in _BINS.items():
        names = dict.fromkeys(n for _, own in summary.iterrows() for n in groups_in(own, field))
        rows = {
            _bin_text(one, unit): _values(summary, f"{field}.{one}.epe_m")
            for one in sorted(names, key=float)
        }
        if rows:
            yield Plot(title, dot_chart(rows, methods, "EPE (m)", is_log=True))
    called = {text: _values(summary, f"movers.{name}", 100.0) for name, text in _CALLED.items()}
    if any(not math.isnan(value) for own in called.values() for value in own.values()):
        yield Plot("Points called dynamic", dot_chart(called, methods, "%"))
    stages = {name: _values(summary, f"{_STAGES}.{name}") for name in part_of(summary, _STAGES)}
    if stages:
        yield Plot("Time per stage", dot_chart(stages, methods, "ms", is_log=True))


def _values(summary: pd.DataFrame, column: str, factor: float = 1.0) -> Mapping[str, float]:
    """Returns the value of each method, NaN for none."""
    values = summary[column] if column in summary else pd.Series(math.nan, summary.index)
    return {str(name): factor * float(value) for name, value in values.items()}


def _bin_text(limit: str, unit: str) -> str:
    return "beyond" if math.isinf(float(limit)) else f"to {limit} {unit}"
