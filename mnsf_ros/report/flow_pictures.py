"""Pictures of a flow and of its error, in the manner of figures 3 and 5 of the paper."""

from __future__ import annotations

import base64
import io
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mnsf_ros.evaluation.flow_wheel import draw_wheel
from mnsf_ros.evaluation.top_view_panel import (
    BACKGROUND,
    INK,
    SLOW,
    Panel,
    draw_panel,
    full_speed,
)
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow
from mnsf_ros.report.error_map import draw_error_map, draw_error_scale
from mnsf_ros.report.pictured import PicturedExample, PicturedFlow

_DPI: Final = 100
_HEIGHT_PX: Final = 476
_SIDE_PX: Final = 400
_BOTTOM_PX: Final = 26
_LEFTS_PX: Final = (36, 484, 932)
_FLOW_WIDTH_PX, _WHOLE_WIDTH_PX = 900, 1384
_SLOW_M: Final = 0.1
_SMALLEST_VIEW_M, _LARGEST_VIEW_M = 10.0, 60.0

Flow = NDArray[np.float64]


class ExamplePainter:
    """Draws the flows of one example, all with the same scales."""

    def __init__(self, example: PicturedExample) -> None:
        """Looks at all flows to find scales that suit them together."""
        self._example = example
        self._finite = np.isfinite(example.xyz).all(axis=1)
        self._xy = example.xyz[self._finite, :2].astype(np.float64)
        self._view_m = _view(self._xy)
        flows = [item.flow for item in example.flows]
        # The truth sets the scale: a method that went astray must not make all others grey.
        flows = flows if example.truth is None else [example.truth]
        parts = [self._parts(flow) for flow in flows]
        self._speed_m = full_speed([part[0] for part in parts], _SLOW_M)
        self._own_speed_m = full_speed([part[1] for part in parts], _SLOW_M)

    def truth(self) -> str | None:
        """Returns the true flow as a data URI; None if there is none."""
        if self._example.truth is None:
            return None
        figure = _figure(_FLOW_WIDTH_PX)
        self._draw_flow(figure, "truth", np.asarray(self._example.truth))
        return _data_uri(figure)

    def method(self, item: PicturedFlow) -> str:
        """Returns the flow of a method, and how wrong it is, as a data URI."""
        figure = _figure(_WHOLE_WIDTH_PX)
        self._draw_flow(figure, item.method, item.flow)
        axes = _axes(figure, _LEFTS_PX[2])
        errors_m = item.error_m[self._finite]
        name = self._example.error_name
        draw_error_map(axes, self._xy, errors_m, title=name, view_m=self._view_m)
        left = (_LEFTS_PX[2] + _SIDE_PX + 8) / _WHOLE_WIDTH_PX
        draw_error_scale(figure, left, _BOTTOM_PX / _HEIGHT_PX)
        return _data_uri(figure)

    def _draw_flow(self, figure: Figure, name: str, flow: NDArray[np.float64]) -> None:
        whole, own = self._parts(flow)
        # The notes of the panels would be larger than the panels: the page says it once.
        panels = (
            Panel(f"{name}: flow", "", self._xy, whole, 4.0, 10.0),
            Panel(f"{name}: what moves", "", self._xy, own, 9.0, 3.0),
        )
        speeds = (self._speed_m, self._own_speed_m)
        for left, panel, speed in zip(_LEFTS_PX, panels, speeds, strict=False):
            axes = _axes(figure, left)
            draw_panel(axes, panel, full_speed_m=speed, slow_m=_SLOW_M, view_m=self._view_m)
            axes.set(xlabel="", ylabel="")
            axes.tick_params(labelsize=8)
            wheel = _axes(figure, left + _SIDE_PX - 70, 58, bottom_px=_BOTTOM_PX + 40)
            draw_wheel(wheel, speed, neutral=SLOW, ink=INK)

    def _parts(self, flow: NDArray[np.float64] | NDArray[np.float32]) -> tuple[Flow, Flow]:
        """The flow (N, 2) as it is, and without the sensor's own motion."""
        example = self._example
        motion = example.next_from_current
        if motion is None:
            reference = flow if example.truth is None else example.truth
            motion = fit_rigid_motion(example.xyz, reference)
        own = residual_flow(example.xyz, flow, motion)
        return (
            flow[self._finite, :2].astype(np.float64),
            own[self._finite, :2].astype(np.float64),
        )


def _view(xy: NDArray[np.float64]) -> float:
    """How far the view reaches: nearly all points, rounded to 5 m."""
    reach = float(np.percentile(np.abs(xy).max(axis=1), 98)) if len(xy) else 0.0
    return float(np.clip(np.ceil(reach / 5.0) * 5.0, _SMALLEST_VIEW_M, _LARGEST_VIEW_M))


def _figure(width_px: float) -> Figure:
    size = (width_px / _DPI, _HEIGHT_PX / _DPI)
    figure = Figure(size, dpi=_DPI, facecolor=BACKGROUND)
    FigureCanvasAgg(figure)
    return figure


def _axes(
    figure: Figure, left_px: float, side_px: float = _SIDE_PX, bottom_px: float = _BOTTOM_PX
) -> Axes:
    width_px, height_px = figure.get_size_inches() * _DPI
    return figure.add_axes(
        (left_px / width_px, bottom_px / height_px, side_px / width_px, side_px / height_px)
    )


def _data_uri(figure: Figure) -> str:
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI, facecolor=BACKGROUND)
    return "data:image/png;base64," + base64.b64encode(picture.getvalue()).decode("ascii")
