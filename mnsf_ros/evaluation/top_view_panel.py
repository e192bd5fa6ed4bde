"""One panel of the top view: points from above in the colors of their flow, and arrows."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from numpy.typing import NDArray

from mnsf_ros.evaluation.flow_wheel import Color, draw_wheel, flow_colors

BACKGROUND: Final = "#101216"
INK: Final = "#e6e6e6"
FAINT_INK: Final = "#9aa0a8"
SWEEPS_PER_ARROW: Final = 5

_FLOOR: Final = "#16191f"
_GRID: Final = "#2b3038"
_SLOW: Final[Color] = (0.36, 0.38, 0.42)
_MISSING: Final[Color] = (0.78, 0.78, 0.78)
_MAX_POINTS: Final = 200_000
_MIN_POINTS_PER_ARROW: Final = 5
# Scales that people can read off a legend, and the powers of ten of them.
_STEPS: Final = (1.0, 1.5, 2.0, 3.0, 5.0, 7.0, 10.0)


@dataclass(frozen=True, eq=False)
class Panel:
    """What one panel shows.

    Attributes:
        title: Its headline.
        note: A line of explanation below it.
        xy: (N, 2) finite metres, sensor frame, x forward, y left.
        flow: (N, 2) metres per sweep; NaN where there is none.
        arrow_cell_m: One arrow for each square of this side that has moving points, metres.
    """

    title: str
    note: str
    xy: NDArray[np.float64]
    flow: NDArray[np.float64]
    arrow_cell_m: float


def full_speed(flows: list[NDArray[np.float64]], slow_m: float) -> float:
    """Returns a round speed that most of what moves stays below, metres per sweep.

    Args:
        flows: Arrays (N, 2), metres per sweep; NaN is left out.
        slow_m: What is slower does not move.
    """
    lengths = np.concatenate([np.hypot(flow[:, 0], flow[:, 1]) for flow in flows])
    moving = lengths[np.isfinite(lengths) & (lengths > slow_m)]
    # Never so fine that the noise of what stands still looks like motion.
    wanted = max(float(np.percentile(moving, 95)) if len(moving) else 0.0, 5.0 * slow_m)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next(step * power for step in _STEPS if step * power >= wanted * 0.999))


def draw_panel(
    axes: Axes, panel: Panel, *, full_speed_m: float, slow_m: float, view_m: float
) -> None:
    """Draws the panel.

    Args:
        axes: Where.
        panel: What.
        full_speed_m: Speed of the full color, metres per sweep.
        slow_m: Slower points are grey, metres per sweep.
        view_m: The view reaches so far from the sensor to each side, metres.
    """
    _draw_floor(axes, panel, view_m)
    xy, flow = _in_view(panel, view_m)
    speeds = np.hypot(flow[:, 0], flow[:, 1])
    missing = ~np.isfinite(speeds)
    axes.scatter(*xy[missing].T, s=0.8, color=[_MISSING], linewidths=0)
    order = np.flatnonzero(~missing)
    order = order[np.argsort(speeds[order], kind="stable")]  # the fastest are drawn on top
    xy, flow, speeds = xy[order], flow[order], speeds[order]
    colors = flow_colors(flow, full_speed_m, neutral=_SLOW)
    colors[speeds < slow_m] = _SLOW
    sizes = 0.8 + 4.0 * np.clip(speeds / full_speed_m, 0.0, 1.0)
    axes.scatter(xy[:, 0], xy[:, 1], s=sizes, c=colors, linewidths=0)
    _draw_arrows(axes, xy[speeds >= slow_m], flow[speeds >= slow_m], panel.arrow_cell_m)
    _draw_sensor(axes, view_m)
    inset = axes.inset_axes((0.845, 0.09, 0.135, 0.135))
    draw_wheel(inset, full_speed_m, neutral=_SLOW, ink=INK)


def _in_view(panel: Panel, view_m: float) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    rows = np.flatnonzero((np.abs(panel.xy) <= view_m).all(axis=1))
    if len(rows) > _MAX_POINTS:
        rows = np.sort(np.random.default_rng(0).choice(rows, _MAX_POINTS, replace=False))
    return panel.xy[rows], panel.flow[rows]


def _draw_floor(axes: Axes, panel: Panel, view_m: float) -> None:
    axes.set_facecolor(_FLOOR)
    axes.set(xlim=(-view_m, view_m), ylim=(-view_m, view_m), aspect="equal")
    axes.set_xlabel("x, forward (m)", color=FAINT_INK)
    axes.set_ylabel("y, left (m)", color=FAINT_INK)
    axes.tick_params(colors=FAINT_INK, length=3)
    axes.grid(color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color(_GRID)
    above: dict[str, Any] = {"transform": axes.transAxes, "verticalalignment": "bottom"}
    axes.text(0.0, 1.045, panel.title, color=INK, fontsize=13, weight="bold", **above)
    axes.text(0.0, 1.01, panel.note, color=FAINT_INK, fontsize=10, **above)


def _draw_arrows(
    axes: Axes, xy: NDArray[np.float64], flow: NDArray[np.float64], cell_m: float
) -> None:
    """One arrow from the middle of the points of each cell, as long as the way of some sweeps."""
    if len(xy) == 0:
        return
    cells = np.floor(xy / cell_m).astype(np.int64)
    _, inverse, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()  # NumPy 2.0 returned it with the shape of a column
    columns = [np.bincount(inverse, column) / counts for column in (*xy.T, *flow.T)]
    x, y, u, v = np.array(columns)[:, counts >= _MIN_POINTS_PER_ARROW] * np.array(
        [[1.0], [1.0], [SWEEPS_PER_ARROW], [SWEEPS_PER_ARROW]]
    )
    axes.quiver(
        x, y, u, v, angles="xy", scale_units="xy", scale=1.0, color=INK, width=0.0022, alpha=0.85
    )


def _draw_sensor(axes: Axes, view_m: float) -> None:
    """A triangle at the origin that points ahead."""
    size = view_m * 0.022
    axes.fill(
        [1.6 * size, -size, -0.5 * size, -size],
        [0.0, size, 0.0, -size],
        facecolor="#ffffff",
        edgecolor=BACKGROUND,
        linewidth=0.8,
        zorder=5,
    )
