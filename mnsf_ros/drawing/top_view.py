# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
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
    SLOW_M,
    SWEEPS_PER_ARROW,
    Panel,
    draw_panel,
    draw_wheel,
    full_speed,
)
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow

_WIDTH_PX: Final = 1600
_ROW_PX: Final = 800
_PANEL_PX: Final = 642
_LEFT_PX: Final = 62
_BELOW_PX: Final = 62
_WHEEL_PX: Final = 78
_VIEW_M: Final = 50.0


def save_top_view(
    path: Path | str,
    xyz: NDArray[Any],
    flow: NDArray[Any],
    *,
    title: str,
    truth: NDArray[Any] | None = None,
    next_from_current: NDArray[np.float64] | None = None,
) -> None:
    """Draws a flow from above into a PNG file of 1600x800 pixels, or 1600x1600 with truth.

    Left the flow as it is, with ego motion; right what moves, which is the flow without one rigid
    motion. Colors and arrows show motion in x and y only.

    Args:
        path: The file; its folder is made if it is missing.
        xyz: (N, 3) metres, sensor frame of the current sweep. Rows that are not finite and
            points beyond 50 m are not drawn; of very many, a random part is.
        flow: (N, 3) metres per sweep; rows that are not finite are drawn in dim grey.
        title: One line above the picture.
        truth: (N, 3) pseudo ground truth flow, drawn as a second row in the same colors.
        next_from_current: (4, 4) ego motion; fitted to each flow if None.

    Raises:
        SweepError: If an array has another shape.
        OSError: If the file cannot be written.
    """
    rows = [_row("" if truth is None else "estimate: ", xyz, flow, next_from_current)]
    if truth is not None:
        rows.append(_row("truth: ", xyz, truth, next_from_current))
    height_px = len(rows) * _ROW_PX
    figure = pixel_figure(_WIDTH_PX, height_px, BACKGROUND)
    _draw_writing(figure, title, height_px)
    for column in range(2):
        # One scale for estimate and truth, or their colors could not be compared.
        scale = full_speed([row[column].flow for row in rows])
        left = column * _WIDTH_PX // 2 + _LEFT_PX
        for number, row in enumerate(rows, start=1):
            bottom = height_px - number * _ROW_PX + _BELOW_PX
            axes = pixel_axes(figure, left, bottom, _PANEL_PX)
            draw_panel(axes, row[column], full_speed_m=scale, view_m=_VIEW_M)
            draw_wheel(pixel_axes(figure, left + _PANEL_PX + 6, bottom + 45, _WHEEL_PX), scale)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(png_bytes(figure))


def _row(
    prefix: str, xyz: NDArray[Any], flow: NDArray[Any], motion: NDArray[np.float64] | None
) -> tuple[Panel, Panel]:
    """The two panels of one flow."""
    if motion is None:
        motion = fit_rigid_motion(xyz, flow)
    residual = residual_flow(xyz, flow, motion)
    finite = np.isfinite(xyz).all(axis=1)
    xy, whole, own = (rows[finite, :2].astype(np.float64) for rows in (xyz, flow, residual))
    way_m, turn = float(np.hypot(*motion[:2, 3])), float(np.arctan2(motion[1, 0], motion[0, 0]))
    num_missing = int(np.count_nonzero(~np.isfinite(flow[finite]).all(axis=1)))
    num_movers = int(np.count_nonzero(np.hypot(*own.T) >= SLOW_M))
    note = f"with ego motion: {way_m:.2f} m and {abs(np.degrees(turn)):.1f}° per sweep"
    if num_missing:
        note += f" · {num_missing:,} points without flow (dim)"
    movers_note = (
        f"without ego motion: {num_movers:,} of {len(xy):,} points faster than {SLOW_M:g} m "
        "per sweep"
    )
    return (
        Panel(f"{prefix}flow", note, xy, whole, fast_area=1.6, arrow_cell_m=10.0),
        Panel(f"{prefix}what moves", movers_note, xy, own, fast_area=7.0, arrow_cell_m=3.0),
    )


def _draw_writing(figure: Figure, title: str, height_px: int) -> None:
    left, top, low = _LEFT_PX / _WIDTH_PX, 1 - 12 / height_px, 2 / height_px
    # A dollar sign in a title is a dollar sign, not a formula.
    figure.text(left, top, title, color=INK, fontsize=17, weight="bold", va="top", parse_math=False)
    hint = (
        f"colour: direction and speed (grey: slow)  ·  arrow: motion over {SWEEPS_PER_ARROW} sweeps"
        "  ·  white triangle: sensor, pointing ahead"
    )
    figure.text(left, low, hint, color=FAINT_INK, fontsize=9, va="bottom")
