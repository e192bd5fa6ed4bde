# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Charts of the report: drawn values, one element of a page, text of others."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import pytest

from mnsf_ros.drawing.charts import (
    curve_chart,
    stage_bars,
    time_text,
)
from mnsf_ros.drawing.figures import DARK, LIGHT, SERIES

BAD = "<script>alert(1)</script>\"'& $x_{"
SVG = "{http://www.w3.org/2000/svg}"


def chart(**values):
    return curve_chart("title", "number of the sweep", [1, 2, 3], values)


def texts(svg):
    return ["".join(part.itertext()) for part in ElementTree.fromstring(svg).iter(f"{SVG}text")]


def marks(svg, series=0):
    """Heights of the marks of a series, larger is lower; without the one of the legend."""
    color = f"var(--s{series})"
    uses = ElementTree.fromstring(svg).iter(f"{SVG}use")
    return [float(part.get("y")) for part in uses if color in part.get("style", "")][:-1]


def test_values_have_marks_and_missing_ones_leave_gaps():
    highest, *_ = drawn = marks(chart(mnsf=[0.3, 0.1, 0.2], fnsf=[math.nan] * 3))
    assert drawn[1] > drawn[2] > highest
    assert len(marks(chart(mnsf=[0.1, math.nan, 0.3]))) == 2
    assert "nan" not in chart(mnsf=[0.1, math.nan, 0.3])


def test_scale_is_logarithmic_only_where_values_differ_much():
    assert "EPE (m)" in texts(chart(mnsf=[0.1, 0.2, 0.3]))
    assert "EPE (m), logarithmic" in texts(chart(mnsf=[0.001, 0.2, 0.3]))
    assert {"0.001", "0.01", "0.1"} <= set(texts(chart(mnsf=[0.001, 0.2, 0.3])))
    assert "nan" not in chart(mnsf=[0.0, 0.0, 0.0])
    assert "nan" not in chart(mnsf=[0.0, 0.001, 1.0])


def test_colors_are_variables_of_the_page():
    drawn = chart(**{f"method {k}": [0.1, 0.2, 0.3] for k in range(30)})
    names = [text for text in texts(drawn) if text.startswith("method")]
    assert names == [f"method {k}" for k in range(30)]
    assert {f"var(--s{k})" for k in range(8)} <= set(re.findall(r"var\(--\w+\)", drawn))
    assert not re.findall("#[0-9a-f]{6}", drawn)
    assert LIGHT.keys() == DARK.keys()
    assert len(set(SERIES)) == 8


@pytest.mark.parametrize(
    "draw",
    [
        lambda: chart(a=[1, 2, 3]),
        chart,
        lambda: curve_chart("errors", "number of the sweep", [105, 115], {"a": [0.1, math.nan]}),
        lambda: stage_bars({"a": {"b": 1}}),
    ],
)
def test_chart_is_one_element_that_is_always_the_same(draw):
    drawn = draw()
    root = ElementTree.fromstring(drawn)
    assert root.tag == f"{SVG}svg"
    assert root.get("role") == "img"
    assert len(root.get("aria-label")) > 20
    assert root.get("width") is None
    assert draw() == drawn


def test_names_of_others_are_only_text():
    for drawn in (chart(**{BAD: [1.0, 2.0, 3.0]}), stage_bars({BAD: {BAD: 1.0}})):
        assert "<script" not in drawn
        assert BAD[:33] + "…" in texts(drawn) or BAD in texts(drawn)


def test_times_have_units():
    times = [time_text(time_ms) for time_ms in (0.12, 12.3, 1500.0, math.nan)]
    assert times == ["0.1 ms", "12 ms", "1.5 s", "-"]


def test_bars_are_as_long_as_their_times_and_one_after_the_other():
    drawn = stage_bars({"a": {"forward": 100.0}, "b": {"forward": 50.0, "fusion": 25.0}})
    assert {"100 ms", "75 ms"} <= set(texts(drawn))
    spans = {}
    for path in ElementTree.fromstring(drawn).iter(f"{SVG}path"):
        hue = re.search(r"fill: var\(--(s\d)\)", path.get("style", ""))
        if hue:
            xs = [float(x) for x in re.findall(r"[ML] ([\d.]+)", path.get("d"))]
            spans.setdefault(hue[1], []).append((min(xs), max(xs)))
    (first, second, *_), (_, fusion, *_) = spans["s0"], spans["s1"]
    whole = first[1] - first[0]
    assert second[1] - second[0] == pytest.approx(whole / 2, abs=0.02)
    assert fusion[0] == pytest.approx(second[1], abs=0.02)
    assert fusion[1] - fusion[0] == pytest.approx(whole / 4, abs=0.02)


def test_curves_stand_over_the_numbers_of_their_sweeps():
    curves = {"a": [0.1, 0.2, 0.1]}
    said = texts(curve_chart("errors", "number of the sweep", [105, 115, 125], curves))
    assert "number of the sweep" in said
    numbers = [int(text) for text in said if text.isdecimal()]
    assert min(numbers) >= 105
    assert max(numbers) <= 130
