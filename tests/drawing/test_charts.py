# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Charts and pictures of examples: what is drawn where, at known values."""

from __future__ import annotations

import math
import re
from xml.etree import ElementTree

import numpy as np
import pytest

from mnsf_ros.drawing.charts import band_chart, curve_chart, stage_bars, stage_names, time_text
from mnsf_ros.drawing.example_pictures import ExamplePainter, error_colors
from mnsf_ros.drawing.figures import DARK, LIGHT, SERIES
from mnsf_ros.drawing.flow_panel import MISSING

BAD = "<script>alert(1)</script>\"'& $x_{"


def chart(**values):
    return band_chart("title", "range (m)", ["a", "b", "c"], values)


def texts(svg):
    return ["".join(part.itertext()) for part in ElementTree.fromstring(svg).iter("text")]


def titles(svg):
    return [part.text for part in ElementTree.fromstring(svg).iter("title")]


def bars(svg):
    """Text of each bar to where it begins and ends, in points."""
    found = {}
    for group in ElementTree.fromstring(svg).iter("g"):
        title, path = group.find("title"), group.find("path")
        if title is not None:
            xs = [float(x) for x in re.findall(r"[ML] ([\d.]+)", path.get("d"))]
            found[title.text] = (min(xs), max(xs))
    return found


def test_every_value_has_a_mark_that_tells_it_and_missing_ones_leave_gaps():
    drawn = chart(mnsf=[0.1, math.nan, 0.3], fnsf=[math.nan] * 3)
    assert titles(drawn) == ["mnsf, a: 0.100", "mnsf, c: 0.300"]
    assert "nan" not in drawn


def test_scale_is_logarithmic_only_where_values_differ_much():
    assert "EPE (m)" in texts(chart(mnsf=[0.1, 0.2, 0.3]))
    assert "EPE (m), logarithmic" in texts(chart(mnsf=[0.001, 0.2, 0.3]))
    assert {"0.001", "0.01", "0.1"} <= set(texts(chart(mnsf=[0.001, 0.2, 0.3])))
    assert "nan" not in chart(mnsf=[0.0, 0.0, 0.0])
    assert "nan" not in chart(mnsf=[0.0, 0.001, 1.0])


def test_higher_values_are_higher():
    drawn = ElementTree.fromstring(chart(mnsf=[0.1, 0.3, 0.2]))
    marks = [g for g in drawn.iter("g") if g.find("title") is not None]
    ys = [float(next(mark.iter("use")).get("y")) for mark in marks]
    assert ys[1] < ys[2] < ys[0]


def test_colors_are_variables_of_the_page():
    drawn = chart(**{f"m{k}": [0.1, 0.2, 0.3] for k in range(9)})
    assert {f"var(--s{k})" for k in range(8)} <= set(re.findall(r"var\(--\w+\)", drawn))
    assert set(re.findall("#[0-9a-f]{6}", drawn)) <= set()
    assert LIGHT.keys() == DARK.keys()
    assert len(set(SERIES)) == 8


@pytest.mark.parametrize("draw", [lambda: chart(a=[1, 2, 3]), lambda: stage_bars({"a": {"b": 1}})])
def test_chart_is_one_element_that_needs_nothing_and_is_always_the_same(draw):
    drawn = draw()
    root = ElementTree.fromstring(drawn)
    assert root.tag == "svg"
    assert root.get("role") == "img"
    assert len(root.get("aria-label")) > 20
    tags = {part.tag for part in root.iter()}
    assert not tags & {"metadata", "style", "clipPath", "image"}
    assert "url(" not in drawn
    assert "xmlns" not in drawn
    assert draw() == drawn


def test_names_of_others_are_only_text():
    for drawn in (chart(**{BAD: [1.0, 2.0, 3.0]}), stage_bars({BAD: {BAD: 1.0}})):
        assert "<script" not in drawn
        assert BAD[:33] + "…" in texts(drawn) or BAD in texts(drawn)
        assert any(title.startswith(BAD) for title in titles(drawn))


@pytest.mark.parametrize("number", [0, 1, 30])
def test_any_number_of_series(number):
    drawn = chart(**{f"method {k}": [0.1, 0.2, 0.3] for k in range(number)})
    assert [text for text in texts(drawn) if text.startswith("method")] == [
        f"method {k}" for k in range(number)
    ]


def test_stages_are_in_the_order_of_the_paper():
    times_ms = {"a": {"fusion": 1.0, "odd": 1.0}, "b": {"prepare": 1.0, "backward": 2.0}}
    assert stage_names(times_ms) == ["prepare", "backward", "fusion", "odd"]


def test_bars_are_as_long_as_their_times_and_one_after_the_other():
    drawn = bars(stage_bars({"a": {"forward": 100.0}, "b": {"forward": 50.0, "fusion": 25.0}}))
    lengths = {name: end - start for name, (start, end) in drawn.items()}
    whole = lengths["a, forward: 100 ms"]
    assert lengths["b, forward: 50 ms"] == pytest.approx(whole / 2, abs=0.02)
    assert lengths["b, fusion: 25 ms"] == pytest.approx(whole / 4, abs=0.02)
    assert drawn["b, fusion: 25 ms"][0] == pytest.approx(drawn["b, forward: 50 ms"][1], abs=0.02)


def test_every_stage_has_a_look_of_its_own():
    drawn = stage_bars({"a": {f"stage {number}": 1.0 for number in range(11)}})
    parts = [g for g in ElementTree.fromstring(drawn).iter("g") if g.find("title") is not None]
    assert len({part.find("path").get("style") for part in parts}) == 11


@pytest.mark.parametrize(
    ("time_ms", "text"), [(0.12, "0.1 ms"), (12.3, "12 ms"), (1500.0, "1.5 s"), (math.nan, "-")]
)
def test_times_in_words(time_ms, text):
    assert time_text(time_ms) == text


def test_error_colors_get_lighter_up_to_the_full_error():
    colors = error_colors(np.array([0.0, 0.1, 0.2, 0.3, 5.0, np.inf, np.nan]))
    lightness = colors @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness[:4]) > 0).all()
    np.testing.assert_array_equal(colors[4], colors[3])
    np.testing.assert_array_equal(colors[5], colors[3])
    np.testing.assert_allclose(colors[6], MISSING)


def test_pictures_are_png_and_the_same_each_time():
    random = np.random.default_rng(3)
    xyz = random.uniform(-20, 20, (300, 3)).astype(np.float32)
    truth = np.tile(np.float32([-0.8, 0, 0]), (300, 1))
    flow = truth + np.float32(0.1)
    for draw in (lambda p: p.truth(), lambda p: p.method(BAD, flow, np.full(300, 0.17))):
        picture = draw(ExamplePainter(xyz, [flow], truth))
        assert picture.startswith(b"\x89PNG")
        assert draw(ExamplePainter(xyz, [flow], truth)) == picture
    assert ExamplePainter(xyz, [flow], None).truth() is None


def test_curves_stand_over_the_numbers_of_their_sweeps():
    curves = {"a": [0.1, 0.2, 0.1]}
    said = texts(curve_chart("errors", "number of the sweep", [105, 115, 125], curves))
    assert "number of the sweep" in said
    numbers = [int(text) for text in said if text.isdecimal()]
    assert min(numbers) >= 105
    assert max(numbers) <= 130
