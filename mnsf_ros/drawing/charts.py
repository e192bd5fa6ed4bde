# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of the studies, each as the bytes of a PNG file."""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from itertools import cycle
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure
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


def _figure(width: float, height: float) -> Figure:
    """Returns an empty figure, in inches, with automatic layout."""
    return Figure((width, height), layout="constrained")


def png_bytes(figure: Figure) -> bytes:
    """Returns the figure as a PNG file; the same figure gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI, metadata={"Software": None})
    return picture.getvalue()
