"""A picture of a flow from above: with and without ego motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mnsf_ros.drawing.figures import pixel_axes, pixel_figure, png_bytes
from mnsf_ros.drawing.flow_panel import (
    BACKGROUND,
    FAINT_INK,
    INK,
    SLOW,
    SWEEPS_PER_ARROW,
    Panel,
    draw_panel,
    full_speed,
)
from mnsf_ros.drawing.flow_wheel import draw_wheel
from mnsf_ros.errors import MnsfError
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow

_WIDTH_PX: Final = 1600
_ROW_PX: Final = 800
_PANEL_PX: Final = 642
_LEFT_PX: Final = 62
_BELOW_PX: Final = 62
_WHEEL_PX: Final = 78


class DrawingError(MnsfError):
    """Something cannot be drawn as asked."""


def save_top_view(
    path: Path | str,
    xyz: NDArray[Any],
    flow: NDArray[Any],
    *,
    title: str,
    truth: NDArray[Any] | None = None,
    next_from_current: NDArray[np.float64] | None = None,
    view_m: float = 50.0,
    slow_m: float = 0.1,
) -> None:
    """Draws a flow from above into a PNG file of 1600x800 pixels, or 1600x1600 with truth.

    Left the flow as it is, with ego motion; right what moves, which is the flow without one rigid
    motion. Colors and arrows show motion in x and y only.

    Args:
        path: The file; its folder is made if it is missing.
        xyz: (N, 3) metres, sensor frame of the current sweep. Rows that are not finite and
            points beyond the view are not drawn; of very many, a random part is.
        flow: (N, 3) metres per sweep; rows that are not finite are drawn in dim grey.
        title: One line above the picture.
        truth: (N, 3) pseudo ground truth flow, drawn as a second row in the same colors.
        next_from_current: (4, 4) ego motion; fitted to each flow if None.
        view_m: The view reaches so far from the sensor to each side, metres.
        slow_m: Slower points are grey, metres per sweep.

    Raises:
        DrawingError: If the view or the slow limit is not a number above 0.
        SweepError: If an array has another shape.
        OSError: If the file cannot be written.
    """
    if not (0 < view_m < np.inf and 0 < slow_m < np.inf):
        raise DrawingError(f"view_m is {view_m!r}, slow_m is {slow_m!r}, expected above 0")
    rows = [_row("" if truth is None else "estimate", xyz, flow, next_from_current, slow_m)]
    if truth is not None:
        rows.append(_row("truth", xyz, truth, next_from_current, slow_m))
    figure = _drawn(rows, title, slow_m=slow_m, view_m=view_m)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png_bytes(figure))


def _drawn(rows: list[tuple[Panel, Panel]], title: str, *, slow_m: float, view_m: float) -> Figure:
    height_px = len(rows) * _ROW_PX
    figure = pixel_figure(_WIDTH_PX, height_px, BACKGROUND)
    _draw_writing(figure, title, height_px)
    for column in range(2):
        # One scale for estimate and truth, or their colors could not be compared.
        scale = full_speed([row[column].flow for row in rows], slow_m)
        for number, row in enumerate(rows):
            left, bottom = column * _WIDTH_PX // 2 + _LEFT_PX, height_px - (number + 1) * _ROW_PX
            axes = pixel_axes(figure, left, bottom + _BELOW_PX, _PANEL_PX)
            draw_panel(axes, row[column], full_speed_m=scale, slow_m=slow_m, view_m=view_m)
            wheel = pixel_axes(figure, left + _PANEL_PX + 6, bottom + _BELOW_PX + 45, _WHEEL_PX)
            draw_wheel(wheel, scale, neutral=SLOW, ink=INK)
    return figure


def _row(
    name: str,
    xyz: NDArray[Any],
    flow: NDArray[Any],
    next_from_current: NDArray[np.float64] | None,
    slow_m: float,
) -> tuple[Panel, Panel]:
    """The two panels of one flow."""
    motion = fit_rigid_motion(xyz, flow) if next_from_current is None else next_from_current
    residual = residual_flow(xyz, flow, motion)
    finite = np.isfinite(xyz).all(axis=1)
    xyz, flow, residual = xyz[finite], flow[finite], residual[finite]
    xy = xyz[:, :2].astype(np.float64)
    prefix = f"{name}: " if name else ""
    way_m, turn = float(np.hypot(*motion[:2, 3])), float(np.arctan2(motion[1, 0], motion[0, 0]))
    num_missing = int(np.count_nonzero(~np.isfinite(flow).all(axis=1)))
    num_movers = int(np.count_nonzero(np.hypot(residual[:, 0], residual[:, 1]) >= slow_m))
    missing_note = f" · {num_missing:,} points without flow (dim)" if num_missing else ""
    return (
        Panel(
            f"{prefix}flow",
            f"with ego motion: {way_m:.2f} m and {abs(np.degrees(turn)):.1f}° "
            f"per sweep{missing_note}",
            xy,
            flow[:, :2].astype(np.float64),
            fast_area=1.6,
            arrow_cell_m=10.0,
        ),
        Panel(
            f"{prefix}what moves",
            f"without ego motion: {num_movers:,} of {len(xy):,} points faster than "
            f"{slow_m:g} m per sweep",
            xy,
            residual[:, :2].astype(np.float64),
            fast_area=7.0,
            arrow_cell_m=3.0,
        ),
    )


def _draw_writing(figure: Figure, title: str, height_px: int) -> None:
    left, top, low = _LEFT_PX / _WIDTH_PX, 1 - 12 / height_px, 8 / height_px
    # A dollar sign in a title is a dollar sign, not a formula.
    figure.text(left, top, title, color=INK, fontsize=17, weight="bold", va="top", parse_math=False)
    hint = (
        f"color: direction and speed (grey: slow)  ·  arrow: motion over {SWEEPS_PER_ARROW} sweeps"
        "  ·  white triangle: sensor, pointing ahead"
    )
    figure.text(left, low, hint, color=FAINT_INK, fontsize=10)
