# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Picture of an object in the other sweeps: hit, passed through or hidden, static and moving."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from mnsf_ros.drawing.figures import CHART_STYLE, FAINT_INK, LINE, SERIES, chart_figure, png_bytes

_PANEL_IN: Final = 3.2
_LEGEND_IN: Final = 0.4
_MARGIN_M: Final = 1.0
_DPI: Final = 120
_COLORS: Final = {
    "hit": SERIES[2],
    "passed through": SERIES[1],
    "hidden": SERIES[3],
    "unclear": SERIES[4],
}


class Panel(NamedTuple):
    """An object in another sweep.

    Attributes:
        title: A line above it.
        points: (Q, 3) metres, the other sweep around it.
        positions: State to (P, 3) metres, the object's points; states as in the legend.
    """

    title: str
    points: NDArray[np.float32]
    positions: dict[str, NDArray[np.float32]]


@mpl.rc_context(CHART_STYLE)
def match_picture(title: str, rows: Sequence[Sequence[Panel]]) -> bytes:
    """Returns a PNG file of panels from above, rows of the same number, at least one.

    All panels show the same part of the world, x to the right and y up.
    """
    width, height = _PANEL_IN * len(rows[0]), _PANEL_IN * len(rows)
    figure = chart_figure(width, height + _LEGEND_IN)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    axes_of = figure.subplots(len(rows), len(rows[0]), sharex=True, sharey=True, squeeze=False)
    everything = [places for row in rows for each in row for places in each.positions.values()]
    xy = np.concatenate(everything)[:, :2]
    low, high = xy.min(axis=0) - _MARGIN_M, xy.max(axis=0) + _MARGIN_M
    middle, half = (low + high) / 2, float((high - low).max()) / 2
    for axes_row, row in zip(axes_of, rows, strict=True):
        for axes, panel in zip(axes_row, row, strict=True):
            _draw(axes, panel)
    axes_of[0, 0].set(
        xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half)
    )
    for axes in axes_of[-1]:
        axes.set_xlabel("x (m)")
    for axes in axes_of[:, 0]:
        axes.set_ylabel("y (m)")
    marks = [
        Line2D([], [], linestyle="", marker="o", color=color, markersize=5, label=name)
        for name, color in _COLORS.items()
    ]
    marks.append(
        Line2D([], [], linestyle="", marker=".", color=FAINT_INK, label="points of that sweep")
    )
    figure.legend(handles=marks, loc="outside lower left", ncols=len(marks))
    return png_bytes(figure, dpi=_DPI)


def _draw(axes: Axes, panel: Panel) -> None:
    axes.set_title(panel.title, fontsize=9)
    axes.set_aspect("equal")
    axes.grid(visible=True, color=LINE, linewidth=0.5)
    x, y, _ = panel.points.T
    axes.scatter(x, y, s=3, color=FAINT_INK, linewidths=0)
    for name, positions in panel.positions.items():
        x, y, _ = positions.T
        axes.scatter(x, y, s=16, color=_COLORS[name], linewidths=0)
