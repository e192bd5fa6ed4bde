"""A picture of a flow from above: as published, and without the sensor's own motion."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Final

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from numpy.typing import NDArray

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.top_view_panel import (
    BACKGROUND,
    FAINT_INK,
    INK,
    SWEEPS_PER_ARROW,
    Panel,
    draw_panel,
    full_speed,
)
from mnsf_ros.sweeps.rigid_motion import fit_rigid_motion, residual_flow

_DPI: Final = 100
_WIDTH_PX: Final = 1600
_ROW_PX: Final = 800


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

    Left the flow as it is, with the sensor's own motion in it; right what moves by itself, which
    is the flow without one rigid motion. Colors and arrows show motion in x and y only.

    Args:
        path: The file; its folder is made if it is missing.
        xyz: (N, 3) metres, sensor frame of the current sweep. Rows that are not finite and
            points beyond the view are not drawn; of very many, a random part is.
        flow: (N, 3) metres per sweep; NaN rows are drawn in pale grey.
        title: One line above the picture.
        truth: (N, 3) pseudo ground truth flow, drawn as a second row in the same colors.
        next_from_current: (4, 4) the sensor's own motion; fitted to each flow if None.
        view_m: The view reaches so far from the sensor to each side, metres.
        slow_m: Slower points are grey, metres per sweep.

    Raises:
        EvaluationError: If the view or the slow limit is not above 0.
        SweepError: If an array has another shape.
        OSError: If the file cannot be written.
    """
    if not (0 < view_m < np.inf and 0 < slow_m < np.inf):
        raise EvaluationError(f"view_m is {view_m!r}, slow_m is {slow_m!r}, expected above 0")
    rows = [_row("estimate" if truth is not None else "", xyz, flow, next_from_current, slow_m)]
    if truth is not None:
        rows.append(_row("truth", xyz, truth, next_from_current, slow_m))
    figure = Figure(
        figsize=(_WIDTH_PX / _DPI, len(rows) * _ROW_PX / _DPI), dpi=_DPI, facecolor=BACKGROUND
    )
    FigureCanvasAgg(figure)
    _draw_title(figure, title, len(rows))
    all_axes = figure.subplots(len(rows), 2, sharex=True, sharey=True, squeeze=False)
    for column in range(2):
        # One scale for estimate and truth, or their colors could not be compared.
        scale = full_speed([row[column].flow for row in rows], slow_m)
        for axes, row in zip(all_axes[:, column], rows, strict=True):
            draw_panel(axes, row[column], full_speed_m=scale, slow_m=slow_m, view_m=view_m)
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, format="png", facecolor=BACKGROUND)


def _row(
    name: str,
    xyz: NDArray[Any],
    flow: NDArray[Any],
    next_from_current: NDArray[np.float64] | None,
    slow_m: float,
) -> tuple[Panel, Panel]:
    """The two panels of one flow."""
    motion = fit_rigid_motion(xyz, flow) if next_from_current is None else next_from_current
    residual = residual_flow(xyz, flow, motion)[:, :2]
    finite = np.isfinite(xyz).all(axis=1)
    xy = xyz[finite, :2].astype(np.float64)
    prefix = f"{name}: " if name else ""
    num_movers = int(np.count_nonzero(np.hypot(*residual[finite].T) >= slow_m))
    way = float(np.linalg.norm(motion[:2, 3]))
    return (
        Panel(
            f"{prefix}flow",
            f"with the sensor's own motion in it ({way:.2f} m per sweep)",
            xy,
            flow[finite, :2].astype(np.float64),
            10.0,
        ),
        Panel(
            f"{prefix}what moves",
            f"without the sensor's own motion: {num_movers:,} of {len(xy):,} points are faster "
            f"than {slow_m:g} m per sweep",
            xy,
            residual[finite].astype(np.float64),
            3.0,
        ),
    )


def _draw_title(figure: Figure, title: str, num_rows: int) -> None:
    figure.subplots_adjust(
        left=0.045, right=0.985, bottom=0.07 / num_rows, top=1 - 0.135 / num_rows, wspace=0.09
    )
    top = 1 - 0.02 / num_rows
    # A dollar sign in a title is a dollar sign, not a formula.
    figure.text(
        0.045, top, title, color=INK, fontsize=17, weight="bold", va="top", parse_math=False
    )
    hint = f"color: direction and speed · arrows: the way of {SWEEPS_PER_ARROW} sweeps · grey: slow"
    figure.text(0.985, top, hint, color=FAINT_INK, fontsize=10, va="top", ha="right")
