# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Figures without a display, as PNG bytes or as SVG of an HTML page."""

from __future__ import annotations

import io
import re
from typing import Any, Final
from xml.sax.saxutils import quoteattr

from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

DPI: Final = 100
# Colours of charts on light and dark ground, by the CSS variables of the page. The eight series
# can be told apart with colour blindness, too.
_COLORS: Final = {
    "ink": ("#1b2027", "#e8eaee"),
    "faint": ("#59626e", "#a3acb8"),
    "line": ("#d9dee5", "#323945"),
    "card": ("#ffffff", "#191d24"),
    "s0": ("#0b62c4", "#6cb0ff"),
    "s1": ("#c4450a", "#ff9a62"),
    "s2": ("#14804a", "#5fd39a"),
    "s3": ("#8e3fb3", "#cf9bf0"),
    "s4": ("#a86a00", "#f0bc4e"),
    "s5": ("#0c7f92", "#5fd0e2"),
    "s6": ("#b3245f", "#ff86b3"),
    "s7": ("#5b6470", "#a9b2bf"),
}
LIGHT: Final = {name: light for name, (light, _) in _COLORS.items()}
DARK: Final = {name: dark for name, (_, dark) in _COLORS.items()}
SERIES: Final = tuple(color for name, color in LIGHT.items() if name.startswith("s"))
INK, FAINT_INK, LINE, CARD = (LIGHT[name] for name in ("ink", "faint", "line", "card"))
_VARIABLES: Final = {color: name for name, color in LIGHT.items()}
_MOST_LETTERS: Final = 34
# The page sets size and font of a chart. Ids of groups would repeat in every chart, and nothing is
# drawn outside of the axes.
_NOT_IN_A_PAGE: Final = (
    r' (width|height)="[\d.]+pt"',
    r"font-family: [^;]*; ",
    r'(?<=<g) id="[^"]*"',
    r' clip-path="[^"]*"',
)
# Style of the charts of a page, for `matplotlib.rc_context` around making and saving them.
CHART_STYLE: Final[dict[str, Any]] = {
    "svg.fonttype": "none",  # text stays text, in the font of the page
    "svg.hashsalt": "mnsf",  # the same chart is the same file
    "text.parse_math": False,  # a dollar sign in a name is no formula
    "font.size": 10.0,
    "text.color": INK,
    "axes.labelcolor": FAINT_INK,
    "axes.edgecolor": LINE,
    "axes.axisbelow": True,
    "axes.spines.left": False,
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": FAINT_INK,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "grid.color": LINE,
    "xtick.color": FAINT_INK,
    "xtick.major.pad": 8,  # room for a mark at zero
    "xtick.major.size": 0,
    "ytick.color": FAINT_INK,
    "ytick.major.size": 0,
    "legend.fontsize": 10,
    "legend.frameon": False,
}


def shortened(name: str, most_letters: int = _MOST_LETTERS) -> str:
    """Returns a name short enough for a chart."""
    return name if len(name) <= most_letters else f"{name[: most_letters - 1]}…"


def png_bytes(figure: Figure, *, dpi: int = DPI) -> bytes:
    """Returns the figure as a PNG file; the same figure gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=dpi, metadata={"Software": None})
    return picture.getvalue()


def chart_figure(width: float, height: float) -> Figure:
    """Returns an empty figure, in inches, with automatic layout."""
    figure = Figure((width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def inline_svg(figure: Figure, label: str) -> str:
    """Returns a chart as an SVG element for an HTML page, its colours as CSS variables.

    Args:
        figure: Chart made in `CHART_STYLE`.
        label: Description for those who do not see it.
    """
    file = io.BytesIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    figure.savefig(file, format="svg", transparent=True, metadata=nothing)
    text = file.getvalue().decode()
    svg = text[text.index("<svg") :].replace(
        "<svg", f'<svg role="img" aria-label={quoteattr(label)}', 1
    )
    for pattern in _NOT_IN_A_PAGE:
        svg = re.sub(pattern, "", svg)
    for color, name in _VARIABLES.items():
        svg = svg.replace(color, f"var(--{name})")
    return svg
