# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The loss landscape as the bytes of a PNG file."""

import io
from collections.abc import Mapping
from typing import Final

import numpy as np
import pandas as pd
from matplotlib.colors import BoundaryNorm
from matplotlib.figure import Figure

_DPI: Final = 120
_LEVELS: Final = 16


def height_maps(title: str, maps: Mapping[str, pd.DataFrame]) -> bytes:
    """Draws the rise of losses in metres above that in the middle, with the same levels for all.

    Each map has losses: (G,) steps as columns, and as rows along the second direction, symmetric,
    0 in the middle.
    """
    figure = Figure((4.2 * len(maps) + 1.0, 5.0), layout="constrained")
    panels = np.atleast_1d(figure.subplots(1, len(maps)))
    rises = [(losses_m - losses_m.at[0.0, 0.0]).clip(lower=0.0) for losses_m in maps.values()]
    highest = max(float(np.percentile(rise, 95)) for rise in rises) or 1.0
    # Denser near the middle; the same levels for all, so that maps can be compared.
    levels = highest * np.linspace(0.0, 1.0, _LEVELS) ** 2
    norm = BoundaryNorm(levels, 256, extend="max")
    for axes, (name, losses_m), rise in zip(panels, maps.items(), rises, strict=True):
        drawn = axes.contourf(rise.columns, rise.index, rise, levels, norm=norm, extend="max")
        axes.contour(rise.columns, rise.index, rise, levels, colors="white", linewidths=0.4)
        axes.plot(0.0, 0.0, "r+", markersize=10)
        axes.set(title=f"{name}\nloss {losses_m.at[0.0, 0.0]:.4f} m", aspect="equal")
        axes.set_xlabel("step along a random direction")
    panels[0].set_ylabel("step along another one")
    ticks = levels[:: _LEVELS // 8]
    bar = figure.colorbar(drawn, ax=list(panels), label="rise of the loss (m)", ticks=ticks)
    bar.set_ticklabels([f"{tick:.2g}" for tick in ticks])
    bar.minorticks_off()
    figure.suptitle(title)
    return png_bytes(figure)


def png_bytes(figure: Figure) -> bytes:
    """Returns the figure as a PNG file; the same figure gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=_DPI, metadata={"Software": None})
    return picture.getvalue()
