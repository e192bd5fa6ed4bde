# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Figures without any display, and what they become: PNG bytes or SVG for an HTML page."""

from __future__ import annotations

import io
import re
from collections.abc import Mapping
from typing import Any, Final
from xml.etree import ElementTree

from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure

DPI: Final = 100
# The colors of charts on light and on dark ground, by the CSS variables that stand for them in an
# HTML page. Of the series there are eight that people with color blindness can tell apart, too.
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
_SVG: Final = "http://www.w3.org/2000/svg"
_XLINK: Final = "http://www.w3.org/1999/xlink"
# A style would hold for the whole page.
_NOT_IN_A_PAGE: Final = ("metadata", "style", "clipPath")
# The look of the charts of a page, for `matplotlib.rc_context` around making and saving them.
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
    """Returns a name that fits into a chart."""
    return name if len(name) <= most_letters else f"{name[: most_letters - 1]}…"


def pixel_figure(width_px: float, height_px: float, background: str) -> Figure:
    """Returns an empty figure, to be filled with `pixel_axes`."""
    figure = Figure((width_px / DPI, height_px / DPI), dpi=DPI, facecolor=background)
    FigureCanvasAgg(figure)
    return figure


def pixel_axes(figure: Figure, left_px: float, bottom_px: float, side_px: float) -> Axes:
    """Adds square axes, placed in pixels from the lower left corner of the figure."""
    width_px, height_px = figure.get_size_inches() * DPI
    return figure.add_axes(
        (left_px / width_px, bottom_px / height_px, side_px / width_px, side_px / height_px)
    )


def png_bytes(figure: Figure, *, dpi: int = DPI) -> bytes:
    """Returns the figure as a PNG file; the same figure gives the same bytes."""
    picture = io.BytesIO()
    figure.savefig(picture, format="png", dpi=dpi, metadata={"Software": None})
    return picture.getvalue()


def chart_figure(width: float, height: float) -> Figure:
    """Returns a figure of so many inches whose parts find their places by themselves."""
    figure = Figure((width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def inline_svg(figure: Figure, label: str, titles: Mapping[str, str]) -> str:
    """Returns a chart as an SVG element for an HTML page, its colours as CSS variables.

    Args:
        figure: Made in `CHART_STYLE`.
        label: What the chart shows, for those who do not see it.
        titles: Group id (`gid`) of an artist to the text that shows when the mouse is over it.
    """
    file = io.BytesIO()
    nothing = dict.fromkeys(("Creator", "Date", "Format", "Type"))
    figure.savefig(file, format="svg", transparent=True, metadata=nothing)
    root = ElementTree.fromstring(file.getvalue())
    for parent in list(root.iter()):
        for part in list(parent):
            if part.tag.removeprefix(f"{{{_SVG}}}") in _NOT_IN_A_PAGE:
                parent.remove(part)
        _adapt(parent, titles)
    for name in ("width", "height", "version"):
        root.attrib.pop(name, None)
    root.set("style", "stroke-linejoin:round;stroke-linecap:butt")
    root.set("role", "img")
    root.set("aria-label", label)
    return ElementTree.tostring(root, encoding="unicode")


def _adapt(part: ElementTree.Element, titles: Mapping[str, str]) -> None:
    """Makes an element of a file one of a page."""
    part.tag = part.tag.removeprefix(f"{{{_SVG}}}")
    if link := part.attrib.pop(f"{{{_XLINK}}}href", None):
        part.set("href", link)
    part.text, part.tail = (text and text.strip() for text in (part.text, part.tail))
    part.attrib.pop("clip-path", None)  # nothing is drawn outside of the axes
    if part.get("transform", "").startswith("rotate(-0 "):
        del part.attrib["transform"]
    for name in part.attrib.keys() & {"d", "x", "y"}:
        part.set(name, re.sub(r"(\.\d\d)\d+", r"\1", part.attrib[name]))
    if part.tag == "g":
        # Ids of matplotlib's groups would occur in every chart of the page.
        title = titles.get(part.attrib.pop("id", ""))
        if title is not None:
            child = ElementTree.Element("title")
            child.text = title
            part.insert(0, child)
    if style := part.get("style"):
        style = re.sub(r"#[0-9a-f]{6}", _variable, style)
        style = re.sub(r"font: ([\d.]+px) [^;]*", r"font-size: \1", style)
        part.set("style", re.sub(r"font-family: [^;]*;?", "", style))


def _variable(found: re.Match[str]) -> str:
    name = _VARIABLES.get(found[0])
    return found[0] if name is None else f"var(--{name})"
