"""A chart of values over bands (of range, of speed), one line for each method, as SVG."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.series import line, mark

_WIDTH, _HEIGHT = 560.0, 330.0
_LEFT, _RIGHT, _TOP, _BOTTOM = 54.0, 14.0, 26.0, 50.0
_STEPS: Final = (1.0, 2.0, 2.5, 5.0, 10.0)
_MOST_TICKS: Final = 6
# Beyond this ratio of largest to smallest value, the small ones would lie on the ground line.
_LOG_RATIO: Final = 30.0
_SMALLEST_SHARE: Final = 1e-3


@dataclass(frozen=True)
class BandChart:
    """What a chart shows.

    Attributes:
        title: Its headline.
        across: What the bands are bands of, with unit.
        up: What the values are, with unit.
        bands: Names of the B bands.
        values: Name of the series to its B values, at least 0; NaN where there is none.
    """

    title: str
    across: str
    up: str
    bands: Sequence[str]
    values: Mapping[str, Sequence[float]]


class _Scale:
    """Value to place on the page: linear from 0, or logarithmic where values differ too much."""

    def __init__(self, values: Sequence[float]) -> None:
        largest = max(values, default=0.0) or 1.0
        # A perfect zero has no logarithm, and must not stretch the scale without end.
        floor = largest * _SMALLEST_SHARE
        smallest = max(min((v for v in values if v > 0), default=largest), floor)
        self.is_log = largest / smallest > _LOG_RATIO
        if self.is_log:
            low, high = math.floor(math.log10(smallest)), math.log10(largest)
            decades = [10.0**power for power in range(low, math.floor(high) + 1)]
            candidates = [decade * factor for decade in decades for factor in (1, 2, 5)]
            self.ticks = [tick for tick in candidates if tick <= largest] or [largest]
            self._low, self._high = math.log10(self.ticks[0]), high
        else:
            self.ticks = linear_ticks(largest)
            self._low, self._high = 0.0, max(self.ticks[-1], largest)

    def __call__(self, value: float) -> float:
        if self.is_log:
            value = math.log10(max(value, 10.0**self._low))
        share = (value - self._low) / ((self._high - self._low) or 1.0)
        return _HEIGHT - _BOTTOM - share * (_HEIGHT - _TOP - _BOTTOM)


def linear_ticks(largest: float) -> list[float]:
    """Returns round numbers from 0 up to at least the largest value, a handful of them."""
    power = 10.0 ** math.floor(math.log10(largest / _MOST_TICKS))
    step = next(s * power for s in _STEPS if s * power * _MOST_TICKS >= largest * (1 - 1e-9))
    return [step * number for number in range(math.ceil(largest / step - 1e-9) + 1)]


def band_chart(chart: BandChart) -> Html:
    """Draws the chart; its series have the numbers of their order in `values`."""
    numbers = [v for values in chart.values.values() for v in values if math.isfinite(v)]
    scale = _Scale(numbers)
    places = _places(len(chart.bands))
    parts = [_grid(chart, scale, places)]
    for number, (name, values) in enumerate(chart.values.items()):
        parts.append(_series(number, name, values, chart, scale, places))
    view = f"0 0 {_WIDTH:g} {_HEIGHT:g}"
    label = f"{chart.title}: {chart.up} over {chart.across}. The numbers are in a table below."
    return element("svg", *parts, viewBox=view, role="img", aria_label=label)


def _places(number: int) -> list[float]:
    width = (_WIDTH - _LEFT - _RIGHT) / max(number, 1)
    return [_LEFT + width * (place + 0.5) for place in range(number)]


def _grid(chart: BandChart, scale: _Scale, places: list[float]) -> Html:
    parts = []
    for tick in scale.ticks:
        y = scale(tick)
        parts.append(element("line", x1=_LEFT, x2=_WIDTH - _RIGHT, y1=y, y2=y, class_="grid"))
        parts.append(element("text", f"{tick:g}", x=_LEFT - 8, y=y + 4.5, text_anchor="end"))
    bottom = _HEIGHT - _BOTTOM
    for place, band in zip(places, chart.bands, strict=True):
        parts.append(element("text", band, x=place, y=bottom + 20, text_anchor="middle"))
    middle = (_LEFT + _WIDTH - _RIGHT) / 2
    parts.append(element("text", chart.across, x=middle, y=_HEIGHT - 6, text_anchor="middle"))
    up = f"{chart.up}, logarithmic" if scale.is_log else chart.up
    parts.append(element("text", up, x=4, y=12))
    return joined(*parts)


def _series(
    number: int,
    name: str,
    values: Sequence[float],
    chart: BandChart,
    scale: _Scale,
    places: list[float],
) -> Html:
    known = [
        (place, value, band)
        for place, value, band in zip(places, values, chart.bands, strict=True)
        if math.isfinite(value)
    ]
    points = [(place, scale(value)) for place, value, _ in known]
    marks = [
        mark(number, place, scale(value), f"{name}, {band}: {value:.3f}")
        for place, value, band in known
    ]
    return joined(*([line(number, points)] if len(points) > 1 else []), *marks)
