"""How a method looks in all charts: color, mark and dashes, never color alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.style import NUM_SERIES

_MARKS: Final = ("circle", "square", "diamond", "triangle", "down")
_DASHES: Final = (None, "6 4", "2 3")
_MARK_SIZE: Final = 4.2


def mark(number: int, x: float, y: float, title: str = "") -> Html:
    """Returns the mark of a series at a place in an SVG, with a title that shows on hovering."""
    size = _MARK_SIZE
    children = [element("title", title)] if title else []
    kind = _MARKS[number % len(_MARKS)]
    css = _css(number)
    if kind == "circle":
        return element("circle", *children, cx=x, cy=y, r=size, class_=css)
    corners = {
        "square": [(-0.9, -0.9), (0.9, -0.9), (0.9, 0.9), (-0.9, 0.9)],
        "diamond": [(0, -1.3), (1.3, 0), (0, 1.3), (-1.3, 0)],
        "triangle": [(0, -1.2), (1.15, 0.9), (-1.15, 0.9)],
        "down": [(0, 1.2), (1.15, -0.9), (-1.15, -0.9)],
    }[kind]
    points = " ".join(f"{x + dx * size:.1f},{y + dy * size:.1f}" for dx, dy in corners)
    return element("polygon", *children, points=points, class_=css)


def line(number: int, points: Sequence[tuple[float, float]]) -> Html:
    """Returns the line of a series through points of an SVG."""
    way = "M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in points)
    return element("path", d=way, class_=f"series {_css(number)}", stroke_dasharray=_dashes(number))


def legend(names: Sequence[str]) -> Html:
    """Returns the legend of series that are numbered from 0."""
    items = [
        element("li", _key(number), element("span", name)) for number, name in enumerate(names)
    ]
    return element("ul", *items, class_="legend")


def _key(number: int) -> Html:
    drawing = joined(line(number, [(0, 7), (26, 7)]), mark(number, 13, 7))
    return element("svg", drawing, viewBox="0 0 26 14", aria_hidden="true")


def _css(number: int) -> str:
    return f"s{number % NUM_SERIES}"


def _dashes(number: int) -> str | None:
    return _DASHES[number // NUM_SERIES % len(_DASHES)]
