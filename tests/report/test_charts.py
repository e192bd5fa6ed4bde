"""Charts, tables and pictures: scales, places and colors at known values."""

from __future__ import annotations

import math
import re

import numpy as np
import pytest
from small_runs import pictured, row, rows

from mnsf_ros.evaluation.tables import TextTable
from mnsf_ros.evaluation.top_view_panel import MISSING
from mnsf_ros.report.band_chart import BandChart, band_chart, linear_ticks
from mnsf_ros.report.error_map import error_colors
from mnsf_ros.report.figures_section import band_names, stage_times_ms
from mnsf_ros.report.flow_pictures import ExamplePainter
from mnsf_ros.report.html import Html, element
from mnsf_ros.report.pictured import focus_method, worst_rows
from mnsf_ros.report.result_table import result_table
from mnsf_ros.report.stage_bars import stage_bars, stage_legend, stage_names, text_of_time


def chart(**values):
    return band_chart(BandChart("title", "range (m)", "EPE (m)", ["a", "b", "c"], values))


@pytest.mark.parametrize(
    ("largest", "ticks"),
    [
        (1.0, [0, 0.2, 0.4, 0.6, 0.8, 1.0]),
        (0.34, [0, 0.1, 0.2, 0.3, 0.4]),
        (6.0, [0, 1, 2, 3, 4, 5, 6]),
        (0.0007, [0, 0.0002, 0.0004, 0.0006, 0.0008]),
    ],
)
def test_ticks_are_round_and_reach_the_largest_value(largest, ticks):
    assert linear_ticks(largest) == pytest.approx(ticks)


def test_missing_values_leave_gaps():
    drawn = chart(mnsf=[0.1, math.nan, 0.3], fnsf=[math.nan] * 3)
    assert drawn.count("<circle") == 2
    assert "nan" not in drawn


def test_scale_is_logarithmic_only_where_values_differ_much():
    assert "logarithmic" not in chart(mnsf=[0.1, 0.2, 0.3])
    assert "logarithmic" in chart(mnsf=[0.001, 0.2, 0.3])
    assert "nan" not in chart(mnsf=[0.0, 0.0, 0.0])


def test_bands_are_named_from_limit_to_limit():
    assert band_names(["10", "20", "inf"]) == ["0–10", "10–20", "20+"]


def test_stages_are_in_the_order_of_the_paper():
    times_ms = {"a": {"fusion": 1.0, "odd": 1.0}, "b": {"prepare": 1.0, "backward": 2.0}}
    assert stage_names(times_ms) == ["prepare", "backward", "fusion", "odd"]


def test_bars_are_as_long_as_their_times():
    drawn = stage_bars({"a": {"forward": 100.0}, "b": {"forward": 50.0}})
    widths = [float(part.split('"')[0]) for part in drawn.split('width="')[1:]]
    assert widths[0] == pytest.approx(2 * widths[1], rel=1e-5)


def test_every_stage_has_a_look_of_its_own():
    times_ms = {"a": {f"stage {number}": 1.0 for number in range(11)}}
    looks = re.findall(r'class="([^"]*shade[^"]*)"', stage_legend(times_ms))
    assert len(set(looks)) == 11
    assert [f"bar {look}" for look in looks] == re.findall(
        r'class="(bar [^"]*)"', stage_bars(times_ms)
    )


def test_time_outside_of_all_stages_is_shown():
    times_ms = stage_times_ms(rows(), ["mnsf"])
    assert times_ms["mnsf"] == pytest.approx({"prepare": 10.0, "forward": 60.0, "other": 30.0})


@pytest.mark.parametrize(
    ("time_ms", "text"), [(0.12, "0.1 ms"), (12.3, "12 ms"), (1500.0, "1.5 s"), (math.nan, "-")]
)
def test_times_in_words(time_ms, text):
    assert text_of_time(time_ms) == text


def test_best_is_smallest_error_and_largest_accuracy():
    table = TextTable(
        ["method", "EPE (m)", "Acc5 (%)", "flows"],
        [["a", "0.1", "50.0", "3"], ["b", "0.2", "60.0", "4"], ["ego", "0.0", "99.0", "5"]],
    )
    text = result_table(table)
    assert text.count('class="best"') == 2
    assert '<td class="best">0.1</td>' in text
    assert '<td class="best">60.0</td>' in text


def test_text_is_escaped_and_html_is_not():
    text = element("p", "a<b", Html("<i>c</i>"), title='"x"', hidden=True, lang=None)
    assert text == '<p title="&quot;x&quot;" hidden>a&lt;b<i>c</i></p>'


def test_error_colors_get_lighter_up_to_the_full_error():
    colors = error_colors(np.array([0.0, 0.1, 0.2, 0.3, 5.0, np.inf, np.nan]))
    lightness = colors @ [0.2126, 0.7152, 0.0722]
    assert (np.diff(lightness[:4]) > 0).all()
    np.testing.assert_array_equal(colors[4], colors[3])
    np.testing.assert_array_equal(colors[5], colors[3])
    np.testing.assert_allclose(colors[6], MISSING)


def test_pictures_are_small_png_and_the_same_each_time():
    painter = ExamplePainter(pictured())
    pictures = [painter.truth(), painter.method(painter._example.flows[0])]
    assert all(uri.startswith("data:image/png;base64,") for uri in pictures)
    assert ExamplePainter(pictured()).truth() == pictures[0]


def test_worst_is_by_error_and_without_truth_by_distance():
    found = [row(n, "a", e) for n, e in ((1, 0.1), (2, 0.3), (3, 0.2))]
    assert [item.number for item in worst_rows(found, "a")] == [2, 3, 1]
    blind = [
        row(n, "a", 0, errors={}, consistency={"nearest_m": d}) for n, d in ((1, 0.1), (2, 0.4))
    ]
    blind += [row(3, "a", 0, errors={}, consistency={}), row(4, "a", 9, failure="no")]
    assert [item.number for item in worst_rows(blind, "a")] == [2, 1]


@pytest.mark.parametrize(
    ("methods", "focus"),
    [(["zero", "fnsf", "mnsf"], "mnsf"), (["zero", "fnsf"], "fnsf"), (["ego"], "ego"), ([], "")],
)
def test_focus_is_the_paper_or_a_method_that_does_something(methods, focus):
    assert focus_method([row(1, method, 0.1) for method in methods], methods) == focus
