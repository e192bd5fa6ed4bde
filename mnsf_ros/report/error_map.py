"""Points from above in the color of their error, as in the paper's figure 5."""

from __future__ import annotations

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mnsf_ros.evaluation.top_view_panel import FAINT_INK, INK, MISSING

# An error that counts as an outlier, whatever the true length, has the full color.
FULL_ERROR_M: Final = 0.3
_FLOOR: Final = "#16191f"
_GRID: Final = "#2b3038"
# Ever lighter, so that errors shine and the order can be seen without telling colors apart.
_COLORS: Final = LinearSegmentedColormap.from_list(
    "error", ["#35507a", "#5c5fa8", "#a35aa6", "#e2636f", "#f79a4b", "#fdf1a0"]
)
_MAX_POINTS: Final = 150_000


def error_colors(errors_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the color of each error: (N,) metres to (N, 3) RGB, dim grey where unknown."""
    shares = np.clip(np.nan_to_num(errors_m, nan=0.0), 0.0, FULL_ERROR_M) / FULL_ERROR_M
    colors = np.asarray(_COLORS(shares), dtype=np.float64)[:, :3]
    colors[np.isnan(errors_m)] = MISSING
    return colors


def draw_error_map(
    axes: Axes,
    xy: NDArray[np.float64],
    errors_m: NDArray[np.float64],
    *,
    title: str,
    view_m: float,
) -> None:
    """Draws the map, the largest errors on top.

    Args:
        axes: Where; should be square.
        xy: (N, 2) finite metres, sensor frame.
        errors_m: (N,) metres; NaN where unknown.
        title: Its headline.
        view_m: The view reaches so far from the sensor to each side, metres.
    """
    axes.set_facecolor(_FLOOR)
    axes.set(xlim=(-view_m, view_m), ylim=(-view_m, view_m), aspect="equal")
    axes.tick_params(colors=FAINT_INK, length=3, labelsize=8)
    axes.grid(color=_GRID, linewidth=0.6)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color(_GRID)
    above: dict[str, Any] = {"transform": axes.transAxes, "verticalalignment": "bottom"}
    axes.text(0.0, 1.055, title, color=INK, fontsize=13, weight="bold", **above)
    axes.text(0.0, 1.01, _note(errors_m), color=FAINT_INK, fontsize=9, **above)
    order = np.argsort(np.nan_to_num(errors_m, nan=-1.0), kind="stable")[-_MAX_POINTS:]
    xy, errors_m = xy[order], errors_m[order]
    areas = 2.0 + 6.0 * np.clip(np.nan_to_num(errors_m), 0.0, FULL_ERROR_M) / FULL_ERROR_M
    axes.scatter(xy[:, 0], xy[:, 1], s=areas, c=error_colors(errors_m), linewidths=0)


def draw_error_scale(figure: Figure, left: float, bottom: float) -> None:
    """Draws the scale of the colors, its lower left corner at a share of the figure's sides."""
    axes = figure.add_axes((left, bottom, 0.008, 0.5))
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, FULL_ERROR_M), _COLORS), cax=axes)
    bar.set_ticks([0.0, 0.05, 0.1, 0.2, 0.3], labels=["0", "0.05", "0.1", "0.2", "0.3+"])
    axes.tick_params(colors=FAINT_INK, length=2, labelsize=8, pad=2)
    axes.set_title("m", color=FAINT_INK, fontsize=8, pad=4)
    bar.ax.spines[:].set_color(_GRID)


def _note(errors_m: NDArray[np.float64]) -> str:
    known = errors_m[np.isfinite(errors_m)]
    if len(known) == 0:
        return "unknown for all points"
    share = float((known >= FULL_ERROR_M).mean())
    return f"mean {known.mean():.3f} m, {share:.0%} of {len(known):,} points 0.3 m or more"
