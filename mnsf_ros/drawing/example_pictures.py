# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures of a flow and of its error, in the manner of figures 3 and 5 of the paper."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.cm import ScalarMappable
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mnsf_ros.drawing.figures import pixel_axes, pixel_figure, png_bytes, shortened
from mnsf_ros.drawing.flow_panel import (
    BACKGROUND,
    FAINT_INK,
    GRID,
    INK,
    MAX_POINTS,
    MISSING,
    Panel,
    draw_floor,
    draw_panel,
    draw_wheel,
    full_speed,
)
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow

_HEIGHT_PX: Final = 484
_SIDE_PX: Final = 400
_BOTTOM_PX: Final = 26
_LEFTS_PX: Final = (36, 484, 932)
_FLOW_WIDTH_PX, _WHOLE_WIDTH_PX = 900, 1384
_MOST_LETTERS: Final = 22
# A picture of one place reaches so far to each side.
_AROUND_M: Final = 12.0
_SMALLEST_VIEW_M, _LARGEST_VIEW_M = 10.0, 60.0
# An error that counts as an outlier, whatever the true length, has the full color.
FULL_ERROR_M: Final = 0.3
# Ever lighter, so that errors shine and the order can be seen without telling colors apart.
_ERROR_COLORS: Final = LinearSegmentedColormap.from_list(
    "error", ["#35507a", "#5c5fa8", "#a35aa6", "#e2636f", "#f79a4b", "#fdf1a0"]
)


class ExamplePainter:
    """Draws the flows of one sweep as PNG files, all with the same scales."""

    def __init__(
        self,
        xyz: NDArray[np.float32],
        flows: Sequence[NDArray[Any]],
        truth: NDArray[np.float32] | None,
        next_from_current: NDArray[np.float64] | None = None,
    ) -> None:
        """Takes what all pictures have in common.

        Args:
            xyz: (N, 3) metres, the points to draw, sensor frame.
            flows: Those of all pictures, (N, 3) metres per sweep; rows that are not finite have
                none.
            truth: (N, 3) metres per sweep, NaN where unknown; None if there is none at all.
            next_from_current: (4, 4) ego motion; None if it is to be fitted.
        """
        self._xyz, self._truth, self._motion = xyz, truth, next_from_current
        self._finite = np.isfinite(xyz).all(axis=1)
        self._xy = xyz[self._finite, :2].astype(np.float64)
        self._view_m = _view(self._xy)
        # The truth sets the scale: a method that went astray must not make all others grey.
        parts = zip(*map(self._parts, flows if truth is None else [truth]), strict=True)
        self._speeds_m = [full_speed(list(part)) for part in parts]

    @property
    def error_name(self) -> str:
        """What errors are: to the true flow, or without truth of moved points to the next sweep."""
        return "distance to next sweep" if self._truth is None else "end point error"

    def truth(self) -> bytes | None:
        """Returns the picture of the true flow; None if there is none."""
        if self._truth is None:
            return None
        figure = pixel_figure(_FLOW_WIDTH_PX, _HEIGHT_PX, BACKGROUND)
        self._draw_flow(figure, "truth", self._truth)
        return png_bytes(figure)

    def method(self, name: str, flow: NDArray[Any], error_m: NDArray[np.floating[Any]]) -> bytes:
        """Returns the picture of the flow of a method, and of how wrong it is.

        `error_m` (N,) is the `error_name` in metres; NaN where unknown.
        """
        figure = pixel_figure(_WHOLE_WIDTH_PX, _HEIGHT_PX, BACKGROUND)
        self._draw_flow(figure, name, flow)
        axes = pixel_axes(figure, _LEFTS_PX[2], _BOTTOM_PX, _SIDE_PX)
        errors_m = error_m[self._finite].astype(np.float64)
        draw_floor(axes, self.error_name, _error_note(errors_m), self._view_m)
        _without_labels(axes)
        _draw_errors(axes, self._xy, errors_m)
        _draw_error_scale(figure)
        return png_bytes(figure)

    def around(self, name: str, flow: NDArray[Any], place_m: tuple[float, float]) -> bytes | None:
        """Returns what moves near a place (x, y), in truth and by a method; None without truth."""
        if self._truth is None:
            return None
        figure = pixel_figure(_FLOW_WIDTH_PX, _HEIGHT_PX, BACKGROUND)
        view_m = max(self._view_m, *(abs(value) + _AROUND_M for value in place_m))
        limits = [(value - _AROUND_M, value + _AROUND_M) for value in place_m]
        both = (("truth", self._truth), (name, flow))
        for left, (whose, motion) in zip(_LEFTS_PX, both, strict=False):
            axes = pixel_axes(figure, left, _BOTTOM_PX, _SIDE_PX)
            title = f"{shortened(whose, _MOST_LETTERS)}: what moves"
            panel = Panel(title, "", self._xy, self._parts(motion)[1], 16.0, 1.5)
            draw_panel(axes, panel, full_speed_m=self._speeds_m[1], view_m=view_m)
            axes.scatter(*place_m, s=3000, facecolors="none", edgecolors=INK, linewidths=1.0)
            axes.set(xlim=limits[0], ylim=limits[1])
            _without_labels(axes)
        return png_bytes(figure)

    def _draw_flow(self, figure: Figure, name: str, flow: NDArray[Any]) -> None:
        whole, own = self._parts(flow)
        # The notes of the panels would be larger than the panels: the page says it once.
        name = shortened(name, _MOST_LETTERS)
        panels = (
            Panel(f"{name}: flow", "", self._xy, whole, 4.0, 10.0),
            Panel(f"{name}: what moves", "", self._xy, own, 9.0, 3.0),
        )
        for left, panel, speed_m in zip(_LEFTS_PX, panels, self._speeds_m, strict=False):
            axes = pixel_axes(figure, left, _BOTTOM_PX, _SIDE_PX)
            draw_panel(axes, panel, full_speed_m=speed_m, view_m=self._view_m)
            _without_labels(axes)
            draw_wheel(pixel_axes(figure, left + _SIDE_PX - 70, _BOTTOM_PX + 40, 58), speed_m)

    def _parts(self, flow: NDArray[Any]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The flow (N, 2) as it is, and without ego motion."""
        motion = self._motion
        if motion is None:
            motion = fit_rigid_motion(self._xyz, flow if self._truth is None else self._truth)
        own = residual_flow(self._xyz, flow, motion)
        return flow[self._finite, :2].astype(np.float64), own[self._finite, :2].astype(np.float64)


def error_colors(errors_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns the colour of each error: (N,) metres to (N, 3) RGB, dim grey where unknown."""
    shares = np.clip(np.nan_to_num(errors_m, nan=0.0), 0.0, FULL_ERROR_M) / FULL_ERROR_M
    colors = np.asarray(_ERROR_COLORS(shares), dtype=np.float64)[:, :3]
    colors[np.isnan(errors_m)] = MISSING
    return colors


def _draw_errors(axes: Axes, xy: NDArray[np.float64], errors_m: NDArray[np.float64]) -> None:
    """Draws points in the colours of their errors, the largest errors on top."""
    order = np.argsort(np.nan_to_num(errors_m, nan=-1.0), kind="stable")[-MAX_POINTS:]
    xy, errors_m = xy[order], errors_m[order]
    areas = 2.0 + 6.0 * np.clip(np.nan_to_num(errors_m), 0.0, FULL_ERROR_M) / FULL_ERROR_M
    axes.scatter(xy[:, 0], xy[:, 1], s=areas, c=error_colors(errors_m), linewidths=0)


def _draw_error_scale(figure: Figure) -> None:
    left = (_LEFTS_PX[2] + _SIDE_PX + 8) / _WHOLE_WIDTH_PX
    axes = figure.add_axes((left, _BOTTOM_PX / _HEIGHT_PX, 0.008, 0.5))
    bar = figure.colorbar(ScalarMappable(Normalize(0.0, FULL_ERROR_M), _ERROR_COLORS), cax=axes)
    bar.set_ticks([0.0, 0.05, 0.1, 0.2, 0.3], labels=["0", "0.05", "0.1", "0.2", "0.3+"])
    axes.tick_params(colors=FAINT_INK, length=2, labelsize=8, pad=2)
    axes.set_title("m", color=FAINT_INK, fontsize=8, pad=4)
    axes.spines[:].set_color(GRID)


def _error_note(errors_m: NDArray[np.float64]) -> str:
    known = errors_m[np.isfinite(errors_m)]
    if len(known) == 0:
        return "unknown for all points"
    share = float((known >= FULL_ERROR_M).mean())
    return f"mean {known.mean():.3f} m, {share:.0%} of {len(known):,} points 0.3 m or more"


def _without_labels(axes: Axes) -> None:
    axes.set(xlabel="", ylabel="")
    axes.tick_params(labelsize=8)


def _view(xy: NDArray[np.float64]) -> float:
    """How far the view reaches: nearly all points, rounded to 5 m."""
    reach = float(np.percentile(np.abs(xy).max(axis=1), 98)) if len(xy) else 0.0
    return float(np.clip(np.ceil(reach / 5.0) * 5.0, _SMALLEST_VIEW_M, _LARGEST_VIEW_M))
