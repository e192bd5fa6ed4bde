# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A small chart for a page as SVG, in the page's own colour of text."""

import math
from collections.abc import Mapping, Sequence
from html import escape
from typing import Final

_WIDTH: Final = 520
_LEFT: Final = 110  # of it for the names of rows
_RIGHT: Final = 20
_ROW: Final = 28
_BELOW: Final = 34
_SMALLEST: Final = 1e-4  # on a logarithmic axis
_NUM_STEPS: Final = 4
_MAX_DECADES: Final = 6
# Distinct with colour blindness, too.
COLORS: Final = ("#0072b2", "#e69f00", "#009e73", "#cc79a7", "#56b4e9", "#d55e00", "#999999")

Rows = Mapping[str, Mapping[str, float]]


def color_of(place: int) -> str:
    """Returns the colour of a series by its place."""
    return COLORS[place % len(COLORS)]


def dot_chart(rows: Rows, series: Sequence[str], unit: str, *, is_log: bool = False) -> str:
    """Returns a line of dots for each row, one for each series that has a value there.

    `unit` is the name of the axis with its unit. A logarithmic axis begins at 0.0001, others end at
    100.
    """
    values = [value for own in rows.values() for value in own.values() if math.isfinite(value)]
    ticks, scaled = (_decades(values), _log) if is_log else (_to_100(values), float)
    low, high = scaled(ticks[0]), scaled(ticks[-1])

    def x_of(value: float) -> float:
        return _LEFT + (scaled(value) - low) / (high - low) * (_WIDTH - _LEFT - _RIGHT)

    bottom = _ROW * len(rows)
    parts = [_text((_LEFT + _WIDTH - _RIGHT) / 2, bottom + 30, unit, "middle")]
    for tick in ticks:
        x = x_of(tick)
        parts += [_line(x, 0, x, bottom), _text(x, bottom + 14, f"{tick:g}", "middle")]
    for place, (name, own) in enumerate(rows.items()):
        y = _ROW * (place + 0.5)
        parts += [_text(_LEFT - 10, y + 4, name, "end"), _line(_LEFT, y, _WIDTH - _RIGHT, y)]
        parts += [
            _dot(x_of(own[one]), y, color_of(number), f"{one}: {own[one]:.4g}")
            for number, one in enumerate(series)
            if math.isfinite(own.get(one, math.nan))
        ]
    height = bottom + _BELOW
    return f'<svg viewBox="0 0 {_WIDTH} {height}" font-size="12" role="img">{"".join(parts)}</svg>'


def _to_100(values: Sequence[float]) -> list[float]:
    """Ticks from the multiple of 20 below all values to 100."""
    low = min(80.0, 20.0 * math.floor(min(values, default=0.0) / 20))
    return [low + (100.0 - low) * step / _NUM_STEPS for step in range(_NUM_STEPS + 1)]


def _decades(values: Sequence[float]) -> list[float]:
    """Ticks at powers of ten around all values."""
    logs = [_log(value) for value in values] or [0.0]
    first, last = math.floor(min(logs)), math.ceil(max(logs))
    step = 1 + (last - first) // _MAX_DECADES
    return [10.0**decade for decade in range(first, max(last, first + 1) + step, step)]


def _log(value: float) -> float:
    return math.log10(max(value, _SMALLEST))


def _dot(x: float, y: float, color: str, title: str) -> str:
    return (
        f'<circle cx="{x:.1f}" cy="{y:g}" r="5" fill="{color}"><title>{escape(title)}</title>'
        "</circle>"
    )


def _line(x1: float, y1: float, x2: float, y2: float) -> str:
    return (
        f'<line x1="{x1:.1f}" y1="{y1:g}" x2="{x2:.1f}" y2="{y2:g}" stroke="currentColor" '
        'stroke-opacity=".2"/>'
    )


def _text(x: float, y: float, text: str, anchor: str) -> str:
    return (
        f'<text x="{x:.1f}" y="{y:g}" text-anchor="{anchor}" fill="currentColor">'
        f"{escape(text)}</text>"
    )
