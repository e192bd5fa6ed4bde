# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Flow seen from above: one panel of points and arrows, and the wheel of its colours."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from mnsf_ros.drawing.color_wheel import SLOW, Color, flow_colors

BACKGROUND: Final = "#101216"
INK: Final = "#e6e6e6"
FAINT_INK: Final = "#9aa0a8"
GRID: Final = "#2b3038"
_FLOOR: Final = "#16191f"
# RGB of points without flow.
MISSING: Final[Color] = (0.21, 0.22, 0.25)
# Slower points do not move, metres per sweep.
SLOW_M: Final = 0.1
SWEEPS_PER_ARROW: Final = 5
MAX_POINTS: Final = 150_000

_SLOW_AREA: Final = 0.8  # of the mark of a point, square typographic points
_MIN_POINTS_PER_ARROW: Final = 5
_WHEEL_PIXELS: Final = 161
# Scales that people can read off a legend, times a power of ten.
_STEPS: Final = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0)


def wheel_image(num_pixels: int = _WHEEL_PIXELS) -> NDArray[np.float64]:
    """Returns the wheel of colours, x to the right and y up, full colour on its rim.

    (P, P, 4) RGBA for P pixels, each 0 to 1, first row on top, transparent outside of the wheel.
    """
    across = np.linspace(-1.0, 1.0, num_pixels)
    x, y = np.meshgrid(across, across[::-1])
    colors = flow_colors(np.column_stack([x.ravel(), y.ravel()]), 1.0)
    # The rim fades over one pixel, so that it is not jagged.
    opacities = np.clip((1.0 - np.hypot(x, y)) * (num_pixels / 2), 0.0, 1.0)
    return np.dstack([colors.reshape(num_pixels, num_pixels, 3), opacities])


def draw_wheel(axes: Axes, full_speed_m: float) -> None:
    """Draws the wheel as a legend into square axes, with the speed of its rim below, metres."""
    axes.set_axis_off()
    axes.imshow(wheel_image(), extent=(-1, 1, -1, 1), interpolation="bilinear")
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    arrow = {"arrowstyle": "-|>", "color": INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(1.0, 0.0), xytext=(0.0, 0.0), arrowprops=arrow)
    below = f"rim: {full_speed_m:g} m\nper sweep"
    axes.text(0.0, -1.15, below, color=INK, fontsize=9, ha="center", va="top")


def full_speed(flows: list[NDArray[np.float64]]) -> float:
    """Returns a round speed that most of what moves in flows (N, 2) stays below, metres per sweep.

    What is not finite is left out.
    """
    lengths = np.concatenate([np.hypot(flow[:, 0], flow[:, 1]) for flow in flows])
    moving = lengths[np.isfinite(lengths) & (lengths >= SLOW_M)]
    # Never so fine that the noise of what stands still looks like motion.
    wanted = max(float(np.percentile(moving, 95)) if len(moving) else 0.0, 5.0 * SLOW_M)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next(step * power for step in _STEPS if step * power >= wanted * 0.999))


@dataclass(frozen=True, eq=False)
class Panel:
    """What one panel shows.

    Attributes:
        title: Its headline.
        note: A line of explanation below it.
        xy: (N, 2) finite metres, sensor frame, x forward, y left.
        flow: (N, 2) metres per sweep; NaN where there is none.
        fast_area: Area of the mark of the fastest points, square typographic points.
        arrow_cell_m: One arrow for each square of this side that has moving points, metres.
    """

    title: str
    note: str
    xy: NDArray[np.float64]
    flow: NDArray[np.float64]
    fast_area: float
    arrow_cell_m: float


def draw_panel(axes: Axes, panel: Panel, *, full_speed_m: float, view_m: float) -> None:
    """Draws a panel into square axes.

    Args:
        axes: Where.
        panel: What.
        full_speed_m: Speed of the full colour, metres per sweep; slow points are grey.
        view_m: The view reaches so far from the sensor to each side, metres.
    """
    draw_floor(axes, panel.title, panel.note, view_m)
    rows = np.flatnonzero((np.abs(panel.xy) <= view_m).all(axis=1))
    if len(rows) > MAX_POINTS:
        rows = np.sort(np.random.default_rng(0).choice(rows, MAX_POINTS, replace=False))
    if len(rows) == 0:
        axes.text(0.0, view_m / 2, "no points in view", color=FAINT_INK, fontsize=13, ha="center")
    xy, flow = panel.xy[rows], panel.flow[rows]
    speeds = np.hypot(flow[:, 0], flow[:, 1])
    missing = ~np.isfinite(speeds)
    axes.scatter(xy[missing, 0], xy[missing, 1], s=_SLOW_AREA, color=[MISSING], linewidths=0)
    order = np.flatnonzero(~missing)
    order = order[np.argsort(speeds[order], kind="stable")]  # the fastest are drawn on top
    xy, flow, speeds = xy[order], flow[order], speeds[order]
    colors = flow_colors(flow, full_speed_m)
    colors[speeds < SLOW_M] = SLOW
    fastness = np.clip(speeds / full_speed_m, 0.0, 1.0)
    areas = _SLOW_AREA + (panel.fast_area - _SLOW_AREA) * fastness
    axes.scatter(xy[:, 0], xy[:, 1], s=areas, c=colors, linewidths=0)
    moving = speeds >= SLOW_M
    _draw_arrows(axes, xy[moving], flow[moving], panel.arrow_cell_m, view_m)
    _draw_sensor(axes, view_m)


def draw_floor(axes: Axes, title: str, note: str, view_m: float) -> None:
    """Draws an empty panel: dark ground, grid and writing, with equal scales of x and y."""
    axes.set_facecolor(_FLOOR)
    axes.set(xlim=(-view_m, view_m), ylim=(-view_m, view_m), aspect="equal")
    axes.set_xlabel("x, forward (m)", color=FAINT_INK)
    axes.set_ylabel("y, left (m)", color=FAINT_INK, labelpad=0)
    axes.tick_params(colors=FAINT_INK, length=3)
    axes.grid(color=GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[:].set_color(GRID)
    # In points above the panel, so that it looks the same in panels of any size. A dollar sign in
    # a name is a dollar sign.
    above: dict[str, Any] = {
        "xycoords": "axes fraction",
        "textcoords": "offset points",
        "verticalalignment": "bottom",
        "parse_math": False,
    }
    left_top = (0.0, 1.0)
    axes.annotate(title, left_top, (0, 18), color=INK, fontsize=13, weight="bold", **above)
    axes.annotate(note, left_top, (0, 4), color=FAINT_INK, fontsize=10, **above)


def _draw_arrows(
    axes: Axes, xy: NDArray[np.float64], flow: NDArray[np.float64], cell_m: float, view_m: float
) -> None:
    """One arrow from the middle of the points of each cell, as long as the way of some sweeps."""
    if len(xy) == 0:
        return
    cells = np.floor(xy / cell_m).astype(np.int64)
    _, inverse, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()  # NumPy 2.0 returned it with the shape of a column
    # An absurd flow must not become a path that the renderer cannot hold.
    ways = np.clip(flow * SWEEPS_PER_ARROW, -4.0 * view_m, 4.0 * view_m)
    means = [np.bincount(inverse, column) / counts for column in (*xy.T, *ways.T)]
    x, y, to_x, to_y = np.array(means)[:, counts >= _MIN_POINTS_PER_ARROW]
    scale: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
    axes.quiver(x, y, to_x, to_y, **scale, color=INK, width=0.0024, alpha=0.9)


def _draw_sensor(axes: Axes, view_m: float) -> None:
    """A triangle at the origin that points ahead."""
    x, y = view_m * 0.022 * np.array([[1.6, -1.0, -0.5, -1.0], [0.0, 1.0, 0.0, -1.0]])
    axes.fill(x, y, facecolor="#ffffff", edgecolor=BACKGROUND, linewidth=0.8, zorder=5)
