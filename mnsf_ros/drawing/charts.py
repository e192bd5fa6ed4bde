# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of the studies and of `mnsf explain`, as the bytes of a PNG file."""

import io
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final, NamedTuple

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from mnsf_ros.arrays import Floats32

if TYPE_CHECKING:
    import pandas as pd

_DPI: Final = 120
_LEVELS: Final = 16
_FAINT: Final = "#59626e"
_PANEL_IN: Final = 3.2
_LEGEND_IN: Final = 0.4
_MARGIN_M: Final = 1.0
# Colours and kind of line of each family of curves, for the colour-blind, too.
_FAMILIES: Final = (("Blues", "-"), ("Oranges", "--"), ("Greys", ":"))
# Distinct with colour blindness, too.
_STATE_COLORS: Final = {
    "hit": "#14804a",
    "passed through": "#c4450a",
    "hidden": "#8e3fb3",
    "unclear": "#a86a00",
}


def height_maps(title: str, maps: "Mapping[str, pd.DataFrame]") -> bytes:
    """Draws the rise of losses above that in the middle, with the same levels in all maps.

    Each map has losses in metres; columns and rows are steps along the two directions, symmetric
    around 0.
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


def curves(
    title: str, families: "Mapping[str, Mapping[str, pd.Series]]", x_label: str, y_label: str
) -> bytes:
    """Draws up to three families of curves, with gaps where a value is NaN.

    Each family has names of curves and their values, with whole numbers x as index. It has one
    colour, darker from curve to curve, and one kind of line.
    """
    figure = _figure(9.0, 4.5)
    axes = figure.subplots()
    for own, (colors, line) in zip(families.values(), _FAMILIES, strict=False):
        shades = np.linspace(0.45, 0.95, len(own)) if len(own) > 1 else [0.75]
        for (name, values), shade in zip(own.items(), shades, strict=True):
            color = mpl.colormaps[colors](shade)
            axes.plot(values.index, values, line, color=color, label=name, linewidth=1.8)
    axes.set(xlabel=x_label, ylabel=y_label)
    axes.set_ylim(bottom=0.0)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True, steps=(1, 2, 5, 10)))
    axes.grid(visible=True, linewidth=0.5, alpha=0.6)
    axes.spines[["top", "right"]].set_visible(False)
    axes.margins(x=0.02)
    axes.set_title(title, loc="left", fontsize=11)
    axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.02), frameon=False)
    return png_bytes(figure)


class Panel(NamedTuple):
    """An object in another sweep."""

    title: str
    points: Floats32  # (Q, 3) metres, the other sweep around it
    positions: dict[str, Floats32]  # its points (P, 3) by their state, see the legend


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
    """Returns an empty figure of a size in inches."""
    return Figure((width, height), layout="constrained")


def png_bytes(figure: Figure) -> bytes:
    """Returns the figure as a PNG file; the same figure gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI, metadata={"Software": None})
    return picture.getvalue()
