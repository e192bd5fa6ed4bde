"""Charts, tables and pictures: scales, places and colors at known values."""

from __future__ import annotations

import pytest
from small_runs import row, rows, run_record

from mnsf_ros.evaluation.result_row import DROPPED
from mnsf_ros.evaluation.tables import TextTable
from mnsf_ros.report.figures_section import band_names, stage_times_ms
from mnsf_ros.report.html import Html, element
from mnsf_ros.report.pictured import focus_method, worst_rows
from mnsf_ros.report.result_table import result_table


def test_bands_are_named_from_limit_to_limit():
    assert band_names(["10", "20", "inf"]) == ["0–10", "10–20", "20+"]


def test_time_outside_of_all_stages_is_shown():
    times_ms = stage_times_ms(rows(), ["mnsf"])
    assert times_ms["mnsf"] == pytest.approx({"prepare": 10.0, "forward": 60.0, "other": 30.0})


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


def test_worst_is_by_error_and_without_truth_by_distance():
    found = [row(n, "a", e) for n, e in ((1, 0.1), (2, 0.3), (3, 0.2))]
    assert [item.number for item in worst_rows(found, "a")] == [2, 3, 1]
    blind = [
        row(n, "a", 0, errors={}, consistency={"nearest_m": d}) for n, d in ((1, 0.1), (2, 0.4))
    ]
    blind += [row(3, "a", 0, errors={}, consistency={}), row(4, "a", 9, failure=DROPPED)]
    assert [item.number for item in worst_rows(blind, "a")] == [2, 1]


@pytest.mark.parametrize(
    ("methods", "focus"),
    [(["zero", "fnsf", "mnsf"], "mnsf"), (["zero", "fnsf"], "fnsf"), (["ego"], "ego"), ([], "")],
)
def test_focus_is_the_paper_or_a_method_that_does_something(methods, focus):
    assert focus_method([row(1, m, 0.1) for m in methods], run_record(methods)) == focus
