# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of the report: errors over sweeps, shares of points, time of each stage."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from typing import Any, Final

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, MaxNLocator, NullLocator

from mnsf_ros.drawing.figures import (
    CARD,
    CHART_STYLE,
    INK,
    SERIES,
    chart_figure,
    inline_svg,
    shortened,
)

_DASHES: Final = ("-", (0, (4, 2.5)), (0, (1, 1.5)))
# Above this ratio of largest to smallest value, a linear scale would hide the small ones.
_LOG_RATIO: Final = 30.0
_SMALLEST_SHARE: Final = 1e-3
_WIDTH, _HEIGHT = 10.4, 3.1
_ERROR: Final = "EPE (m)"
_LEGEND_ROW, _BAR_ROW = 0.21, 0.32


@mpl.rc_context(CHART_STYLE)
def curve_chart(
    title: str, across: str, places: Sequence[int], curves: Mapping[str, Sequence[float]]
) -> str:
    """Returns errors of N sweeps in order as inline SVG, one curve for each series.

    `across` names the N places. Each series has N values in metres, at least 0, NaN where there
    is none.
    """
    figure, axes, columns = _with_legend(_WIDTH, _HEIGHT, curves)
    for number, (name, values) in enumerate(curves.items()):
        hue, dashes = number % len(SERIES), number // len(SERIES) % len(_DASHES)
        # A sweep between two without a flow is a point, which a line alone would not show.
        look: dict[str, Any] = {"marker": ".", "markersize": 4.0, "linewidth": 1.2}
        look |= {"color": SERIES[hue], "linestyle": _DASHES[dashes], "label": shortened(name)}
        axes.plot(places, values, **look)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    _set_error_scale(axes, across, curves)
    _draw_legend(figure, axes, columns)
    return inline_svg(figure, f"{title}: {_ERROR} over {across}.")


def _set_error_scale(axes: Axes, across: str, series: Mapping[str, Sequence[float]]) -> None:
    """Sets a scale of errors: linear from 0, or logarithmic where values differ too much."""
    axes.set_xlabel(across)
    axes.grid(axis="y")
    numbers = [value for values in series.values() for value in values if math.isfinite(value)]
    largest = max(numbers, default=0.0) or 1.0
    # A perfect zero has no logarithm, and must not stretch the scale without end.
    floor = largest * _SMALLEST_SHARE
    smallest = max(min((v for v in numbers if v > 0), default=largest), floor)
    if largest / smallest > _LOG_RATIO:
        axes.set_yscale("log", nonpositive="clip")
        axes.set_ylim(smallest / 1.3, largest * 1.3)
        axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0), numticks=12))
        axes.yaxis.set_minor_locator(NullLocator())
        axes.yaxis.set_major_formatter("{x:g}")
        axes.set_title(f"{_ERROR}, logarithmic")
    else:
        axes.set_ylim(0.0, largest * 1.08)
        axes.set_title(_ERROR)


@mpl.rc_context(CHART_STYLE)
def stage_bars(times_ms: Mapping[str, Mapping[str, float]]) -> str:
    """Returns a bar for each method, its stages stacked, as inline SVG.

    `times_ms` has method to stage to mean wall time, milliseconds.
    """
    stages = list(dict.fromkeys(stage for parts in times_ms.values() for stage in parts))
    totals_ms = {name: math.fsum(part.values()) for name, part in times_ms.items()}
    longest_ms = max(totals_ms.values(), default=0.0) or 1.0
    figure, axes, columns = _with_legend(_WIDTH, _BAR_ROW * len(times_ms) + 0.15, stages)
    lefts_ms = [0.0] * len(times_ms)
    for number, stage in enumerate(stages):
        parts_ms = [part.get(stage, 0.0) for part in times_ms.values()]
        # With more stages than hues, the hues repeat, ever lighter.
        color, alpha = SERIES[number % len(SERIES)], 0.5 ** (number // len(SERIES))
        look: dict[str, Any] = {"color": color, "alpha": alpha, "ec": CARD, "lw": 0.8}
        axes.barh(range(len(times_ms)), parts_ms, 0.6, lefts_ms, label=shortened(stage), **look)
        lefts_ms = [left + part for left, part in zip(lefts_ms, parts_ms, strict=True)]
    for row, total_ms in enumerate(totals_ms.values()):
        axes.text(total_ms + 0.008 * longest_ms, row, time_text(total_ms), va="center")
    axes.set_yticks(range(len(times_ms)), [shortened(name) for name in times_ms], color=INK)
    axes.set(xlim=(0, 1.09 * longest_ms), ylim=(len(times_ms) - 0.5, -0.5), xticks=[])
    axes.spines["bottom"].set_visible(False)
    _draw_legend(figure, axes, columns)
    said = "; ".join(f"{name} {total_ms:.0f} ms" for name, total_ms in totals_ms.items())
    return inline_svg(figure, f"Mean wall time of an estimate, by stage. {said}.")


def time_text(time_ms: float) -> str:
    """Returns a time with its unit, rounded for reading."""
    if math.isnan(time_ms):
        return "-"
    if time_ms >= 1000:
        return f"{time_ms / 1000:.1f} s"
    return f"{time_ms:.0f} ms" if time_ms >= 10 else f"{time_ms:.1f} ms"


def _with_legend(width: float, height: float, names: Collection[str]) -> tuple[Figure, Axes, int]:
    """Returns a figure, in inches, with room for a legend below, and the legend's columns."""
    longest = max((len(shortened(name)) for name in names), default=0)
    columns = max(1, int(width / (0.55 + 0.085 * longest)))
    figure = chart_figure(width, height + _LEGEND_ROW * math.ceil(len(names) / columns))
    return figure, figure.subplots(), columns


def _draw_legend(figure: Figure, axes: Axes, columns: int) -> None:
    handles, names = axes.get_legend_handles_labels()
    if names:
        figure.legend(handles, names, loc="outside lower left", ncols=columns)
