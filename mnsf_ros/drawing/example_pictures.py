# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of a flow and its error from above, in the manner of figures 3 and 5 of the paper."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mnsf_ros.drawing.color_wheel import SLOW, Color, flow_colors, wheel_image
from mnsf_ros.drawing.figures import DPI, png_bytes, shortened
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow

_BACKGROUND, _FLOOR, _GRID = "#101216", "#16191f", "#2b3038"
_INK, _FAINT_INK = "#e6e6e6", "#9aa0a8"
# RGB of points without flow or with unknown error.
MISSING: Final[Color] = (0.21, 0.22, 0.25)
# Slower points are grey, metres per sweep.
_SLOW_M: Final = 0.1
_SWEEPS_PER_ARROW: Final = 5
_MIN_POINTS_PER_ARROW: Final = 5
_MAX_POINTS: Final = 150_000
_SLOW_AREA, _FAST_AREA = 0.8, 9.0  # of the mark of a point, square typographic points
_ARROW_CELL_M: Final = 3.0
# Scales that are easy to read, times a power of ten.
_STEPS: Final = (1.0, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 7.0, 10.0)

_HEIGHT_PX: Final = 484
_SIDE_PX: Final = 400
_BOTTOM_PX: Final = 26
_LEFTS_PX: Final = (36, 484, 932)
_WIDTH_PX: Final = 1384
_MOST_LETTERS: Final = 22
# Reach of a picture of one place to each side.
_SMALLEST_VIEW_M, _LARGEST_VIEW_M = 10.0, 60.0
# Outliers of any true length have the full colour.
_FULL_ERROR_M: Final = 0.3
# Ever lighter, so that the order shows without telling colours apart.
_ERROR_COLORS: Final = LinearSegmentedColormap.from_list(
    "error", ["#35507a", "#5c5fa8", "#a35aa6", "#e2636f", "#f79a4b", "#fdf1a0"]
)


def example_picture(
    name: str,
    xyz: NDArray[np.float32],
    flow: NDArray[Any],
    error_m: NDArray[np.floating[Any]],
    truth: NDArray[np.float32] | None = None,
    next_from_current: NDArray[np.float64] | None = None,
) -> bytes:
    """Returns a PNG file: what moves in truth and by a method side by side, and its errors.

    Without truth, the whole flow is in the first place.

    Args:
        name: Name of the method.
        xyz: (N, 3) metres, the points to draw, sensor frame.
        flow: (N, 3) metres per sweep; rows without flow are not finite.
        error_m: (N,) end point error, or without truth distance from the moved points to the next
            sweep; NaN where unknown.
        truth: (N, 3) metres per sweep, NaN where unknown; None without truth.
        next_from_current: (4, 4) ego motion; None: fitted to the truth, or to the flow.
    """
    known = flow if truth is None else truth
    motion = fit_rigid_motion(xyz, known) if next_from_current is None else next_from_current
    finite = np.isfinite(xyz).all(axis=1)
    xy = xyz[finite, :2].astype(np.float64)
    view_m = _view(xy)

    def own(flow: NDArray[Any]) -> NDArray[np.float64]:
        return residual_flow(xyz, flow, motion)[finite, :2].astype(np.float64)

    figure = Figure((_WIDTH_PX / DPI, _HEIGHT_PX / DPI), dpi=DPI, facecolor=_BACKGROUND)
    share = (_SIDE_PX / _WIDTH_PX, _SIDE_PX / _HEIGHT_PX)
    left, middle, right = (
        figure.add_axes((x / _WIDTH_PX, _BOTTOM_PX / _HEIGHT_PX, *share)) for x in _LEFTS_PX
    )
    name = shortened(name, _MOST_LETTERS)
    # The truth sets the scale: a diverged flow must not make all grey.
    full_speed_m = full_speed(own(known))
    if truth is None:
        whole = flow[finite, :2].astype(np.float64)
        _draw_flow(left, f"{name}: flow", xy, whole, full_speed(whole), view_m)
    else:
        _draw_flow(left, "truth: what moves", xy, own(truth), full_speed_m, view_m)
    _draw_flow(middle, f"{name}: what moves", xy, own(flow), full_speed_m, view_m)
    errors_m = error_m[finite].astype(np.float64)
    title = "distance to next sweep" if truth is None else "end point error"
    _draw_floor(right, title, view_m, _error_note(errors_m))
    _draw_errors(right, xy, errors_m)
    _draw_error_scale(figure)
    return png_bytes(figure)


def _draw_flow(
    axes: Axes,
    title: str,
    xy: NDArray[np.float64],
    flow: NDArray[np.float64],
    full_speed_m: float,
    view_m: float,
) -> None:
    _draw_floor(axes, title, view_m)
    _draw_points(axes, xy, flow, full_speed_m, view_m)
    _draw_arrows(axes, xy, flow, view_m)
    _draw_wheel(axes, full_speed_m)


def full_speed(flow: NDArray[np.float64]) -> float:
    """Returns a round speed above that of most moving points of a flow (N, 2), metres per sweep.

    Rows that are not finite are left out.
    """
    lengths = np.hypot(flow[:, 0], flow[:, 1])
    moving = lengths[np.isfinite(lengths) & (lengths >= _SLOW_M)]
    # Never so fine that the noise of static points looks like motion.
    wanted = max(float(np.percentile(moving, 95)) if len(moving) else 0.0, 5.0 * _SLOW_M)
    power = 10.0 ** np.floor(np.log10(wanted))
    return float(next(step * power for step in _STEPS if step * power >= wanted * 0.999))


def error_colors(errors_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the colour of each error: (N,) metres to (N, 3) RGB, dim grey where unknown."""
    shares = np.clip(np.nan_to_num(errors_m, nan=0.0), 0.0, _FULL_ERROR_M) / _FULL_ERROR_M
    colors = np.asarray(_ERROR_COLORS(shares), dtype=np.float64)[:, :3]
    colors[np.isnan(errors_m)] = MISSING
    return colors


def _view(xy: NDArray[np.float64]) -> float:
    """Returns the reach of the view: nearly all points, rounded to 5 m."""
    reach = float(np.percentile(np.abs(xy).max(axis=1), 98)) if len(xy) else 0.0
    return float(np.clip(np.ceil(reach / 5.0) * 5.0, _SMALLEST_VIEW_M, _LARGEST_VIEW_M))


def _draw_floor(axes: Axes, title: str, view_m: float, note: str = "") -> None:
    """Draws an empty panel: dark ground, grid, writing, and the sensor as a triangle."""
    axes.set_facecolor(_FLOOR)
    axes.set(xlim=(-view_m, view_m), ylim=(-view_m, view_m), aspect="equal")
    axes.tick_params(colors=_FAINT_INK, length=3, labelsize=8)
    axes.grid(color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    axes.spines[:].set_color(_GRID)
    above: dict[str, Any] = {
        "xycoords": "axes fraction",
        "textcoords": "offset points",
        "verticalalignment": "bottom",
        "parse_math": False,  # a dollar sign in a name is no formula
    }
    left_top = (0.0, 1.0)
    axes.annotate(title, left_top, (0, 18), color=_INK, fontsize=13, weight="bold", **above)
    axes.annotate(note, left_top, (0, 4), color=_FAINT_INK, fontsize=10, **above)
    x, y = view_m * 0.022 * np.array([[1.6, -1.0, -0.5, -1.0], [0.0, 1.0, 0.0, -1.0]])
    axes.fill(x, y, facecolor="#ffffff", edgecolor=_BACKGROUND, linewidth=0.8, zorder=5)


def _draw_points(
    axes: Axes,
    xy: NDArray[np.float64],
    flow: NDArray[np.float64],
    full_speed_m: float,
    view_m: float,
) -> None:
    """Draws points (N, 2) in the colours of their flow (N, 2), the fastest on top and largest."""
    rows = np.flatnonzero((np.abs(xy) <= view_m).all(axis=1))
    if len(rows) > _MAX_POINTS:
        rows = np.sort(np.random.default_rng(0).choice(rows, _MAX_POINTS, replace=False))
    if len(rows) == 0:
        axes.text(0.0, view_m / 2, "no points in view", color=_FAINT_INK, fontsize=13, ha="center")
    xy, flow = xy[rows], flow[rows]
    speeds = np.hypot(flow[:, 0], flow[:, 1])
    missing = ~np.isfinite(speeds)
    axes.scatter(xy[missing, 0], xy[missing, 1], s=_SLOW_AREA, color=[MISSING], linewidths=0)
    order = np.flatnonzero(~missing)
    order = order[np.argsort(speeds[order], kind="stable")]
    colors = flow_colors(flow[order], full_speed_m)
    colors[speeds[order] < _SLOW_M] = SLOW
    areas = _SLOW_AREA + (_FAST_AREA - _SLOW_AREA) * np.clip(speeds[order] / full_speed_m, 0.0, 1.0)
    axes.scatter(xy[order, 0], xy[order, 1], s=areas, c=colors, linewidths=0)


def _draw_arrows(
    axes: Axes, xy: NDArray[np.float64], flow: NDArray[np.float64], view_m: float
) -> None:
    """Draws the mean motion over some sweeps as an arrow for each cell with moving points."""
    moving = np.hypot(flow[:, 0], flow[:, 1]) >= _SLOW_M  # NaN is not
    moving &= (np.abs(xy) <= view_m).all(axis=1)
    if not moving.any():
        return
    cells = np.floor(xy[moving] / _ARROW_CELL_M).astype(np.int64)
    _, inverse, counts = np.unique(cells, axis=0, return_inverse=True, return_counts=True)
    inverse = inverse.ravel()  # NumPy 2.0 returned it with the shape of a column
    # An absurd flow must not become a path that the renderer cannot hold.
    ways = np.clip(flow[moving] * _SWEEPS_PER_ARROW, -4.0 * view_m, 4.0 * view_m)
    means = [np.bincount(inverse, column) / counts for column in (*xy[moving].T, *ways.T)]
    x, y, to_x, to_y = np.array(means)[:, counts >= _MIN_POINTS_PER_ARROW]
    scale: dict[str, Any] = {"angles": "xy", "scale_units": "xy", "scale": 1.0}
    axes.quiver(x, y, to_x, to_y, **scale, color=_INK, width=0.0024, alpha=0.9)


def _draw_wheel(panel: Axes, full_speed_m: float) -> None:
    """Draws the wheel of colours in a corner, with the speed of its rim below."""
    axes = panel.inset_axes((1 - 70 / _SIDE_PX, 40 / _SIDE_PX, 58 / _SIDE_PX, 58 / _SIDE_PX))
    axes.set_axis_off()
    axes.imshow(wheel_image(), extent=(-1, 1, -1, 1), interpolation="bilinear")
    axes.set(xlim=(-1.05, 1.05), ylim=(-1.05, 1.05), aspect="equal")
    arrow = {"arrowstyle": "-|>", "color": _INK, "linewidth": 1.0, "shrinkA": 0, "shrinkB": 0}
    axes.annotate("", xy=(1.0, 0.0), xytext=(0.0, 0.0), arrowprops=arrow)
    below = f"rim: {full_speed_m:g} m\nper sweep"
    axes.text(0.0, -1.15, below, color=_INK, fontsize=9, ha="center", va="top")


def _draw_errors(axes: Axes, xy: NDArray[np.float64], errors_m: NDArray[np.float64]) -> None:
    """Draws points in the colours of their errors, the largest errors on top."""
    order = np.argsort(np.nan_to_num(errors_m, nan=-1.0), kind="stable")[-_MAX_POINTS:]
    xy, errors_m = xy[order], errors_m[order]
    areas = 2.0 + 6.0 * np.clip(np.nan_to_num(errors_m), 0.0, _FULL_ERROR_M) / _FULL_ERROR_M
    axes.scatter(xy[:, 0], xy[:, 1], s=areas, c=error_colors(errors_m), linewidths=0)


def _draw_error_scale(figure: Figure) -> None:
    left = (_LEFTS_PX[2] + _SIDE_PX + 8) / _WIDTH_PX
    axes = figure.add_axes((left, _BOTTOM_PX / _HEIGHT_PX, 0.008, 0.5))
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, _FULL_ERROR_M), _ERROR_COLORS), cax=axes)
    bar.set_ticks([0.0, 0.05, 0.1, 0.2, 0.3], labels=["0", "0.05", "0.1", "0.2", "0.3+"])
    axes.tick_params(colors=_FAINT_INK, length=2, labelsize=8, pad=2)
    axes.set_title("m", color=_FAINT_INK, fontsize=8, pad=4)
    axes.spines[:].set_color(_GRID)


def _error_note(errors_m: NDArray[np.float64]) -> str:
    known = errors_m[np.isfinite(errors_m)]
    if len(known) == 0:
        return "unknown for all points"
    share = float((known >= _FULL_ERROR_M).mean())
    return f"mean {known.mean():.3f} m, {share:.0%} of {len(known):,} points 0.3 m or more"
