# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of the report: values over bands, and the time of each stage."""

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

_MARKS: Final = ("o", "s", "D", "^", "v")
_DASHES: Final = ("-", (0, (4, 2.5)), (0, (1, 1.5)))
# More areas than hues: then the hues come again, ever lighter.
_SHADES: Final = (1.0, 0.5, 0.22)
# Beyond this ratio of largest to smallest value, the small ones would lie on the ground line.
_LOG_RATIO: Final = 30.0
_SMALLEST_SHARE: Final = 1e-3
_BAND_WIDTH, _BAND_HEIGHT, _BAR_WIDTH = 5.2, 3.1, 10.4
_ERROR: Final = "EPE (m)"
_LEGEND_ROW, _BAR_ROW = 0.21, 0.32
_KNOWN_STAGES: Final = ("prepare", "forward", "backward", "fusion")


@mpl.rc_context(CHART_STYLE)
def band_chart(
    title: str, across: str, bands: Sequence[str], values: Mapping[str, Sequence[float]]
) -> str:
    """Returns errors over B bands as inline SVG, one line for each series.

    `across` says what the bands are bands of, with unit. Each series has B values in metres, at
    least 0, NaN where there is none. Colour is never its only mark.
    """
    figure, axes, columns = _with_legend(_BAND_WIDTH, _BAND_HEIGHT, values)
    titles: dict[str, str] = {}
    for number, (name, series) in enumerate(values.items()):
        titles |= _draw_series(axes, number, name, series, bands)
    _set_scale(axes, [value for series in values.values() for value in series])
    axes.set_xticks(range(len(bands)), bands)
    axes.set(xlim=(-0.5, len(bands) - 0.5), xlabel=across)
    axes.grid(axis="y")
    _draw_legend(figure, axes, columns)
    label = f"{title}: {_ERROR} over {across}. The numbers are in a table below."
    return inline_svg(figure, label, titles)


@mpl.rc_context(CHART_STYLE)
def curve_chart(
    title: str, across: str, places: Sequence[int], curves: Mapping[str, Sequence[float]]
) -> str:
    """Returns errors of N sweeps in order as inline SVG, one curve for each series.

    `across` says what the N places are. Each series has N values in metres, at least 0, NaN where
    there is none.
    """
    figure, axes, columns = _with_legend(_BAR_WIDTH, _BAND_HEIGHT, curves)
    for number, (name, values) in enumerate(curves.items()):
        # A sweep between two without a flow is a point, which a line alone would not show.
        look = _look(number) | {"marker": ".", "markersize": 4.0, "linewidth": 1.2}
        axes.plot(places, values, label=shortened(name), **look)
    _set_scale(axes, [value for series in curves.values() for value in series])
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set_xlabel(across)
    axes.grid(axis="y")
    _draw_legend(figure, axes, columns)
    return inline_svg(figure, f"{title}: {_ERROR} over {across}.", {})


@mpl.rc_context(CHART_STYLE)
def share_bars(
    title: str, across: str, bins: Sequence[str], shares: Mapping[str, Sequence[float]]
) -> str:
    """Returns shares of points in B bins as inline SVG, a bar for each bin and series.

    Each series has B shares from 0 to 1.
    """
    figure, axes, columns = _with_legend(_BAR_WIDTH, _BAND_HEIGHT, shares)
    titles: dict[str, str] = {}
    width = 0.8 / max(1, len(shares))
    for number, (name, series) in enumerate(shares.items()):
        look = {"color": _look(number)["color"], "edgecolor": CARD, "linewidth": 0.5}
        for place, share in enumerate(series):
            key = f"share-{number}-{place}"
            left = place - 0.4 + number * width
            label = shortened(name) if place == 0 else None
            axes.bar(left, 100 * share, width, align="edge", gid=key, label=label, **look)
            titles[key] = f"{name}, {bins[place]} m: {share:.1%}"
    axes.set_xticks(range(len(bins)), bins)
    axes.set(xlim=(-0.5, len(bins) - 0.5), xlabel=across, title="points (%)")
    axes.grid(axis="y")
    _draw_legend(figure, axes, columns)
    return inline_svg(figure, f"{title}: share of points over {across}.", titles)


def _look(number: int) -> dict[str, Any]:
    """How the line of a series looks; colour is never its only mark."""
    return {
        "color": SERIES[number % len(SERIES)],
        "linestyle": _DASHES[number // len(SERIES) % len(_DASHES)],
        "marker": _MARKS[number % len(_MARKS)],
        "markersize": 5.5,
        "linewidth": 1.7,
    }


def _draw_series(
    axes: Axes, number: int, name: str, values: Sequence[float], bands: Sequence[str]
) -> dict[str, str]:
    """Draws one line; returns the text of each of its marks."""
    known = [place for place, value in enumerate(values) if math.isfinite(value)]
    look = _look(number)
    axes.plot(known, [values[place] for place in known], label=shortened(name), **look)
    titles = {}
    for place in known:
        key = f"mark-{number}-{place}"
        (mark,) = axes.plot([place], [values[place]], gid=key, **look)
        mark.set_label("_")
        titles[key] = f"{name}, {bands[place]}: {values[place]:.3f}"
    return titles


def _set_scale(axes: Axes, values: Sequence[float]) -> None:
    """Linear from 0, or logarithmic where values differ too much."""
    numbers = [value for value in values if math.isfinite(value)]
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
    stages = stage_names(times_ms)
    totals_ms = {name: math.fsum(part.values()) for name, part in times_ms.items()}
    longest_ms = max(totals_ms.values(), default=0.0) or 1.0
    figure, axes, columns = _with_legend(_BAR_WIDTH, _BAR_ROW * len(times_ms) + 0.15, stages)
    titles = _draw_bars(axes, times_ms, stages)
    for row, total_ms in enumerate(totals_ms.values()):
        axes.text(total_ms + 0.008 * longest_ms, row, time_text(total_ms), va="center")
    axes.set_yticks(range(len(times_ms)), [shortened(name) for name in times_ms], color=INK)
    axes.set(xlim=(0, 1.09 * longest_ms), ylim=(len(times_ms) - 0.5, -0.5), xticks=[])
    axes.spines["bottom"].set_visible(False)
    _draw_legend(figure, axes, columns)
    said = "; ".join(f"{name} {total_ms:.0f} ms" for name, total_ms in totals_ms.items())
    return inline_svg(figure, f"Mean wall time of an estimate, by stage. {said}.", titles)


def _draw_bars(
    axes: Axes, times_ms: Mapping[str, Mapping[str, float]], stages: Sequence[str]
) -> dict[str, str]:
    """Draws the parts of all bars; returns the text of each of them."""
    titles = {}
    for number, stage in enumerate(stages):
        look: dict[str, Any] = {
            "color": SERIES[number % len(SERIES)],
            "alpha": _SHADES[number // len(SERIES) % len(_SHADES)],
        }
        axes.barh(0, 0.0, label=shortened(stage), **look)
        for row, (method, part) in enumerate(times_ms.items()):
            if part.get(stage, 0.0) > 0:
                key = f"bar-{number}-{row}"
                left_ms = math.fsum(part.get(before, 0.0) for before in stages[:number])
                axes.barh(row, part[stage], 0.6, left_ms, ec=CARD, lw=0.8, gid=key, **look)
                titles[key] = f"{method}, {stage}: {time_text(part[stage])}"
    return titles


def stage_names(times_ms: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Returns the stages of all methods: those of the paper's method first, in its order."""
    found = dict.fromkeys(stage for stages in times_ms.values() for stage in stages)
    first = [name for name in _KNOWN_STAGES if name in found]
    return first + [name for name in found if name not in _KNOWN_STAGES]


def time_text(time_ms: float) -> str:
    """Returns a time with its unit, rounded for reading."""
    if math.isnan(time_ms):
        return "-"
    if time_ms >= 1000:
        return f"{time_ms / 1000:.1f} s"
    return f"{time_ms:.0f} ms" if time_ms >= 10 else f"{time_ms:.1f} ms"


def _with_legend(width: float, height: float, names: Collection[str]) -> tuple[Figure, Axes, int]:
    """A figure of so many inches with room for a legend of these names below, and its columns."""
    longest = max((len(shortened(name)) for name in names), default=0)
    columns = max(1, int(width / (0.55 + 0.085 * longest)))
    figure = chart_figure(width, height + _LEGEND_ROW * math.ceil(len(names) / columns))
    return figure, figure.subplots(), columns


def _draw_legend(figure: Figure, axes: Axes, columns: int) -> None:
    handles, names = axes.get_legend_handles_labels()
    if names:
        figure.legend(handles, names, loc="outside lower left", ncols=columns)
