# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of the studies and of `mnsf explain`, each as the bytes of a PNG file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

_DPI: Final = 120
# They can be told apart with colour blindness, too.
_SERIES: Final = (
    *("#0b62c4", "#c4450a", "#14804a", "#8e3fb3"),
    *("#a86a00", "#0c7f92", "#b3245f", "#5b6470"),
)
_LEVELS: Final = 16
_LOOKS: Final = (("o", "-"), ("s", "--"), ("^", ":"))
_GROUP_COLORS: Final = (_SERIES[0], "#e2703a", "#8a94a3")
_FAINT: Final = "#59626e"
_PANEL_IN: Final = 3.2
_LEGEND_IN: Final = 0.4
_MARGIN_M: Final = 1.0
_STATE_COLORS: Final = {
    "hit": _SERIES[2],
    "passed through": _SERIES[1],
    "hidden": _SERIES[3],
    "unclear": _SERIES[4],
}


def grouped_bars(
    title: str, rows: Sequence[str], panels: Mapping[str, Mapping[str, Sequence[float]]]
) -> bytes:
    """Draws groups of horizontal bars in R rows.

    Each panel has a title, and groups with R values each, NaN where there is none.
    """
    figure = _figure(9.0, 1.2 + 0.5 * len(rows))
    axes_of = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    for axes, (name, groups) in zip(axes_of, panels.items(), strict=True):
        for place, (group, values) in enumerate(groups.items()):
            heights = [row + 0.26 * (place - 1) for row in range(len(rows))]
            color = _GROUP_COLORS[place % len(_GROUP_COLORS)]
            axes.barh(heights, values, height=0.24, label=group, color=color)
        axes.set_yticks(range(len(rows)), list(rows))
        axes.set_title(name, fontsize=10)
        axes.grid(axis="x", alpha=0.3)
        axes.set_axisbelow(True)
    axes_of[0].invert_yaxis()
    handles, names = axes_of[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    figure.suptitle(title)
    return png_bytes(figure)


def height_maps(
    title: str, maps: Mapping[str, tuple[NDArray[np.float64], NDArray[np.float64], float]]
) -> bytes:
    """Draws the rise of losses in metres above that in the middle, with the same levels for all.

    Each map has (G,) steps, symmetric, 0 in the middle; (G, G) losses, rows along the second
    direction; and the loss in the middle.
    """
    figure = _figure(4.2 * len(maps) + 1.0, 5.0)
    panels = np.atleast_1d(figure.subplots(1, len(maps)))
    rises = [np.maximum(losses_m - middle_m, 0.0) for _, losses_m, middle_m in maps.values()]
    highest = max(float(np.percentile(rise, 95)) for rise in rises) or 1.0
    # Denser near the middle; the same levels for all, so that maps can be compared.
    levels = highest * np.linspace(0.0, 1.0, _LEVELS) ** 2
    norm = BoundaryNorm(levels, 256, extend="max")
    for axes, (name, (steps, _, middle_m)), rise in zip(panels, maps.items(), rises, strict=True):
        drawn = axes.contourf(steps, steps, rise, levels, norm=norm, extend="max")
        axes.contour(steps, steps, rise, levels, colors="white", linewidths=0.4)
        axes.plot(0.0, 0.0, "r+", markersize=10)
        axes.set(title=f"{name}\nloss {middle_m:.4f} m", aspect="equal")
        axes.set_xlabel("step along a random direction")
    panels[0].set_ylabel("step along another one")
    ticks = levels[:: _LEVELS // 8]
    bar = figure.colorbar(drawn, ax=list(panels), label="rise of the loss (m)", ticks=ticks)
    bar.set_ticklabels([f"{tick:.2g}" for tick in ticks])
    bar.minorticks_off()
    figure.suptitle(title)
    return png_bytes(figure)


def log_lines(
    title: str,
    across: str,
    sizes: Sequence[int],
    panels: Mapping[str, Mapping[str, Mapping[str, Mapping[int, float]]]],
) -> bytes:
    """Draws panels of lines over ascending sizes, with one over the size for comparison.

    Each panel has groups of lines of one colour; each line has values above 0 by their size.
    """
    figure = _figure(11.0, 5.0)
    axes_of = np.atleast_1d(figure.subplots(1, len(panels)))
    for axes, (name, groups) in zip(axes_of, panels.items(), strict=True):
        _draw_log_lines(axes, sizes, groups)
        axes.set_xlabel(across)
        axes.set_title(name)
    axes_of[-1].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.suptitle(title)
    return png_bytes(figure)


def _draw_log_lines(
    axes: Axes, sizes: Sequence[int], groups: Mapping[str, Mapping[str, Mapping[int, float]]]
) -> None:
    top = 0.0
    for (group, lines), color in zip(groups.items(), cycle(_SERIES)):
        for (line, values), (mark, dashes) in zip(lines.items(), cycle(_LOOKS)):
            if values:
                x, y = list(values), list(values.values())
                label, top = f"{group}, {line}", max(top, *y)
                axes.loglog(x, y, color=color, marker=mark, ls=dashes, label=label)
    guide = [(top or 1.0) * sizes[0] / size for size in sizes]
    axes.loglog(sizes, guide, color="grey", lw=1.0, ls="-.", label="1/N")
    axes.set_xticks(sizes, [f"{size:,}" for size in sizes])
    axes.minorticks_off()
    axes.grid(which="major", alpha=0.3)


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


@mpl.rc_context({"text.parse_math": False})  # a dollar sign in a name is no formula
def match_picture(title: str, rows: Sequence[Sequence[Panel]]) -> bytes:
    """Returns a PNG file of panels from above, rows of the same number, at least one.

    All panels show the same part of the world, x to the right and y up.
    """
    width, height = _PANEL_IN * len(rows[0]), _PANEL_IN * len(rows)
    figure = _figure(width, height + _LEGEND_IN)
    figure.suptitle(title, x=0.01, ha="left", fontsize=11)
    axes_of = figure.subplots(len(rows), len(rows[0]), sharex=True, sharey=True, squeeze=False)
    everything = [places for row in rows for each in row for places in each.positions.values()]
    xy = np.concatenate(everything)[:, :2]
    low, high = xy.min(axis=0) - _MARGIN_M, xy.max(axis=0) + _MARGIN_M
    middle, half = (low + high) / 2, float((high - low).max()) / 2
    for axes_row, row in zip(axes_of, rows, strict=True):
        for axes, panel in zip(axes_row, row, strict=True):
            _draw_match(axes, panel)
    axes_of[0, 0].set(
        xlim=(middle[0] - half, middle[0] + half), ylim=(middle[1] - half, middle[1] + half)
    )
    for axes in axes_of[-1]:
        axes.set_xlabel("x (m)")
    for axes in axes_of[:, 0]:
        axes.set_ylabel("y (m)")
    marks = [
        Line2D([], [], linestyle="", marker="o", color=color, markersize=5, label=name)
        for name, color in _STATE_COLORS.items()
    ]
    marks.append(
        Line2D([], [], linestyle="", marker=".", color=_FAINT, label="points of that sweep")
    )
    figure.legend(handles=marks, loc="outside lower left", ncols=len(marks))
    return png_bytes(figure)


def _draw_match(axes: Axes, panel: Panel) -> None:
    axes.set_title(panel.title, fontsize=9)
    axes.set_aspect("equal")
    axes.grid(visible=True, linewidth=0.5)
    x, y, _ = panel.points.T
    axes.scatter(x, y, s=3, color=_FAINT, linewidths=0)
    for name, positions in panel.positions.items():
        x, y, _ = positions.T
        axes.scatter(x, y, s=16, color=_STATE_COLORS[name], linewidths=0)


def _figure(width: float, height: float) -> Figure:
    """Returns an empty figure, in inches, with automatic layout."""
    return Figure((width, height), layout="constrained")


def png_bytes(figure: Figure) -> bytes:
    """Returns the figure as a PNG file; the same figure gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI, metadata={"Software": None})
    return picture.getvalue()
