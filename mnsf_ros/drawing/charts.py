# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of the studies and of `mnsf explain`, each as the bytes of a PNG file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import TYPE_CHECKING, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from numpy.typing import NDArray

if TYPE_CHECKING:
    import pandas as pd

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


def grouped_bars(title: str, panels: Mapping[str, pd.DataFrame]) -> bytes:
    """Draws horizontal bars: for each panel a group for each row, a bar for each column."""
    num_rows = max(len(table) for table in panels.values())
    figure = _figure(9.0, 1.2 + 0.5 * num_rows)
    axes_of = np.atleast_1d(figure.subplots(1, len(panels), sharey=True))
    for axes, (name, table) in zip(axes_of, panels.items(), strict=True):
        table.plot.barh(ax=axes, width=0.78, color=_GROUP_COLORS, legend=False, xlabel="")
        axes.set_title(name, fontsize=10)
        axes.grid(axis="x", alpha=0.3)
        axes.set_axisbelow(True)
    axes_of[0].invert_yaxis()
    handles, names = axes_of[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    figure.suptitle(title)
    return png_bytes(figure)


def height_maps(title: str, maps: Mapping[str, pd.DataFrame]) -> bytes:
    """Draws the rise of losses in metres above that in the middle, with the same levels for all.

    Each map has losses: (G,) steps as columns, and as rows along the second direction, symmetric,
    0 in the middle.
    """
    figure = _figure(4.2 * len(maps) + 1.0, 5.0)
    panels = np.atleast_1d(figure.subplots(1, len(maps)))
    rises = [(losses_m - losses_m.at[0.0, 0.0]).clip(lower=0.0) for losses_m in maps.values()]
    highest = max(float(np.percentile(rise, 95)) for rise in rises) or 1.0
    # Denser near the middle; the same levels for all, so that maps can be compared.
    levels = highest * np.linspace(0.0, 1.0, _LEVELS) ** 2
    norm = BoundaryNorm(levels, 256, extend="max")
    for axes, (name, losses_m), rise in zip(panels, maps.items(), rises, strict=True):
        drawn = axes.contourf(rise.columns, rise.index, rise, levels, norm=norm, extend="max")
        axes.contour(rise.columns, rise.index, rise, levels, colors="white", linewidths=0.4)
        axes.plot(0.0, 0.0, "r+", markersize=10)
        axes.set(title=f"{name}\nloss {losses_m.at[0.0, 0.0]:.4f} m", aspect="equal")
        axes.set_xlabel("step along a random direction")
    panels[0].set_ylabel("step along another one")
    ticks = levels[:: _LEVELS // 8]
    bar = figure.colorbar(drawn, ax=list(panels), label="rise of the loss (m)", ticks=ticks)
    bar.set_ticklabels([f"{tick:.2g}" for tick in ticks])
    bar.minorticks_off()
    figure.suptitle(title)
    return png_bytes(figure)


def log_lines(title: str, across: str, panels: Mapping[str, pd.DataFrame]) -> bytes:
    """Draws panels of lines over ascending sizes, with one over the size for comparison.

    Each panel has sizes as rows, and a line for each column (group, name); groups have a colour
    each. Values are above 0, or NaN.
    """
    figure = _figure(11.0, 5.0)
    axes_of = np.atleast_1d(figure.subplots(1, len(panels)))
    for axes, (title_of_panel, lines) in zip(axes_of, panels.items(), strict=True):
        colors = dict(zip(lines.columns.unique(0), cycle(_SERIES)))
        looks = dict(zip(lines.columns.unique(1), cycle(_LOOKS)))
        for (group, name), values in lines.dropna(axis=1, how="all").items():
            style = dict(zip(("marker", "ls"), looks[name], strict=True))
            axes.loglog(values.dropna(), color=colors[group], label=f"{group}, {name}", **style)
        sizes, top = lines.index.to_numpy(), np.nanmax(lines)
        axes.loglog(sizes, top * sizes[0] / sizes, color="grey", lw=1.0, ls="-.", label="1/N")
        axes.set_xticks(sizes, [f"{size:,}" for size in sizes])
        axes.minorticks_off()
        axes.grid(which="major", alpha=0.3)
        axes.set(xlabel=across, title=title_of_panel)
    axes_of[-1].legend(fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    figure.suptitle(title)
    return png_bytes(figure)


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
