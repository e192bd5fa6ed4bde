# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The plots of the report: errors by range and by speed, precision and recall, time per stage."""

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Final, NamedTuple

import pandas as pd

from mnsf_ros.evaluation.summary import groups_in, part_of

# Part of the summary to title, and unit of its limits.
_BINS: Final = {"by_range": ("EPE by range", "m"), "by_speed": ("EPE by true speed", "m/s")}
_STAGES: Final = "stage_times_ms"
_CALLED: Final = {"precision": "precision", "recall": "recall", "iou": "IoU"}
_SMALLEST: Final = 1e-4  # on a logarithmic axis
_NUM_STEPS: Final = 4
_MAX_DECADES: Final = 6
# Of methods by their place; distinct with colour blindness, too.
COLORS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#999999")


class Plot(NamedTuple):
    """A plot: rows of dots, one for each method. Places on the axis are 0 to 1."""

    title: str
    axis: str  # name with the unit
    ticks: list[tuple[float, float]]  # place and value
    rows: dict[str, list[tuple[str, float, float]]]  # of each dot method, place and value


def plots_of(summary: pd.DataFrame) -> Iterator[Plot]:
    """Yields the plots of a summary, those that have values."""
    for field, (title, unit) in _BINS.items():
        names = {name for _, own in summary.iterrows() for name in groups_in(own, field)}
        columns = {
            f"{field}.{name}.epe_m": "beyond" if name == "inf" else f"to {name} {unit}"
            for name in sorted(names, key=float)
        }
        yield from _plot(title, "EPE (m)", _table(summary, columns), _decades, _log)
    called = _table(summary, {f"movers.{name}": text for name, text in _CALLED.items()})
    yield from _plot("Points called dynamic", "%", 100.0 * called, _to_100, float)
    stages = _table(summary, {f"{_STAGES}.{name}": name for name in part_of(summary, _STAGES)})
    yield from _plot("Time per stage", "ms", stages, _decades, _log)


def _table(summary: pd.DataFrame, columns: dict[str, str]) -> pd.DataFrame:
    """Returns some columns under other names, NaN for those that are missing."""
    return summary.reindex(columns=list(columns)).set_axis(list(columns.values()), axis=1)


def _plot(
    title: str,
    axis: str,
    table: pd.DataFrame,
    ticks_of: Callable[[Sequence[float]], list[float]],
    scaled: Callable[[float], float],
) -> Iterator[Plot]:
    """Yields the plot of a table, a row for each of its columns, if it has values."""
    columns = {name: column.dropna() for name, column in table.items()}
    values = [value for own in columns.values() for value in own]
    if not values:
        return
    ticks = ticks_of(values)
    low, high = scaled(ticks[0]), scaled(ticks[-1])

    def place_of(value: float) -> float:
        return (scaled(value) - low) / (high - low)

    rows = {
        str(name): [(str(method), place_of(value), value) for method, value in own.items()]
        for name, own in columns.items()
    }
    yield Plot(title, axis, [(place_of(tick), tick) for tick in ticks], rows)


def _to_100(values: Sequence[float]) -> list[float]:
    """Ticks from the multiple of 20 below all values to 100."""
    low = min(80.0, 20.0 * math.floor(min(values) / 20))
    return [low + (100.0 - low) * step / _NUM_STEPS for step in range(_NUM_STEPS + 1)]


def _decades(values: Sequence[float]) -> list[float]:
    """Ticks at powers of ten around all values."""
    logs = [_log(value) for value in values]
    first, last = math.floor(min(logs)), math.ceil(max(logs))
    step = 1 + (last - first) // _MAX_DECADES
    return [10.0**decade for decade in range(first, max(last, first + 1) + step, step)]


def _log(value: float) -> float:
    return math.log10(max(value, _SMALLEST))
