"""Time of each stage of each method as stacked bars, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final

from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.style import area_class

_WIDTH: Final = 1060.0
_ROW: Final = 34.0
_BAR: Final = 20.0
_TOTAL: Final = 92.0
_LETTER: Final = 7.6
_MOST_LETTERS: Final = 34
_KNOWN: Final = ("prepare", "forward", "backward", "fusion")


def stage_names(times_ms: Mapping[str, Mapping[str, float]]) -> list[str]:
    """Returns the stages of all methods: those of the paper's method first, in its order."""
    found = dict.fromkeys(stage for stages in times_ms.values() for stage in stages)
    return [name for name in _KNOWN if name in found] + [n for n in found if n not in _KNOWN]


def stage_bars(times_ms: Mapping[str, Mapping[str, float]]) -> Html:
    """Draws a bar for each method.

    Args:
        times_ms: Method to stage to mean wall time, milliseconds.
    """
    stages = stage_names(times_ms)
    longest = max((sum(part.values()) for part in times_ms.values()), default=0.0) or 1.0
    letters = min(max(map(len, times_ms), default=0), _MOST_LETTERS)
    left = letters * _LETTER + 16
    per_ms = (_WIDTH - left - _TOTAL) / longest
    rows = [
        _row(number, method, part, stages, left, per_ms)
        for number, (method, part) in enumerate(times_ms.items())
    ]
    view = f"0 0 {_WIDTH:g} {_ROW * len(rows):g}"
    said = "; ".join(f"{name} {sum(part.values()):.0f} ms" for name, part in times_ms.items())
    label = f"Mean wall time of an estimate, by stage. {said}."
    return element("svg", *rows, viewBox=view, role="img", aria_label=label)


def stage_legend(times_ms: Mapping[str, Mapping[str, float]]) -> Html:
    """Returns the legend of the bars."""
    items = []
    for number, stage in enumerate(stage_names(times_ms)):
        box = element("rect", x=0, y=1, width=26, height=12, class_=area_class(number))
        key = element("svg", box, viewBox="0 0 26 14", aria_hidden="true")
        items.append(element("li", key, element("span", stage)))
    return element("ul", *items, class_="legend")


def text_of_time(time_ms: float) -> str:
    """Returns a time as people would say it."""
    if math.isnan(time_ms):
        return "-"
    if time_ms >= 1000:
        return f"{time_ms / 1000:.1f} s"
    return f"{time_ms:.0f} ms" if time_ms >= 10 else f"{time_ms:.1f} ms"


def _row(
    number: int,
    method: str,
    part: Mapping[str, float],
    stages: Sequence[str],
    left: float,
    per_ms: float,
) -> Html:
    middle = _ROW * (number + 0.5)
    name = method if len(method) <= _MOST_LETTERS else f"{method[: _MOST_LETTERS - 1]}…"
    parts = [element("text", name, x=left - 12, y=middle + 4.5, text_anchor="end", class_="name")]
    x = left
    for place, stage in enumerate(stages):
        width = part.get(stage, 0.0) * per_ms
        if width > 0:
            title = element("title", f"{method}, {stage}: {text_of_time(part[stage])}")
            bar = {"x": x, "y": middle - _BAR / 2, "width": width, "height": _BAR, "rx": 2}
            parts.append(element("rect", title, **bar, class_=f"bar {area_class(place)}"))
        x += width
    total = text_of_time(sum(part.values()))
    parts.append(element("text", total, x=x + 8, y=middle + 4.5, class_="value"))
    return joined(*parts)
