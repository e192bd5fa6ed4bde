# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Figures of the report: bands, times, best values and worst sweeps at known values."""

from __future__ import annotations

import pytest
from small_runs import row, rows, run_record

from mnsf_ros.evaluation.results import DROPPED
from mnsf_ros.report.run_results import results_of
from mnsf_ros.report.tables import bin_names
from mnsf_ros.report.text_table import TextTable


def test_bands_are_named_from_limit_to_limit():
    assert bin_names(["10", "20", "inf"]) == ["0–10", "10–20", "20+"]


def test_time_outside_of_all_stages_is_shown():
    figures = results_of(run_record(), rows()).sweeps["mnsf"]
    assert figures.stage_times_ms == pytest.approx(
        {"prepare": 10.0, "forward": 60.0, "other": 30.0}
    )


def test_best_is_smallest_error_and_largest_accuracy_but_never_a_reference():
    table = TextTable(
        ["method", "EPE (m)", "Acc5 (%)", "flows", "angle"],
        [
            ["a", "0.1", "50.0", "3", "-"],
            ["b", "0.2", "60.0", "4", "1.0"],
            ["reference", "0.0", "99.0", "5", "0.5"],
        ],
        better=[None, min, max, None, min],
    )
    # Of a single value nothing can be the best.
    assert table.best_cells({"reference"}) == {(0, 1), (1, 2)}


def test_worst_is_by_error_and_without_truth_by_distance():
    found = [row(n, "a", e) for n, e in ((1, 0.1), (2, 0.3), (3, 0.2))]
    assert [one.number for one in results_of(run_record(["a"]), found).worst] == [2, 3, 1]
    blind = [
        row(n, "a", 0, errors={}, consistency={"nearest_m": d}) for n, d in ((1, 0.1), (2, 0.4))
    ]
    blind += [row(3, "a", 0, errors={}, consistency={}), row(4, "a", 9, failure=DROPPED)]
    assert [one.number for one in results_of(run_record(["a"]), blind).worst] == [2, 1]


@pytest.mark.parametrize(
    ("methods", "focus"),
    [(["zero", "fnsf", "mnsf"], "fnsf"), (["zero", "fnsf"], "fnsf"), (["ego"], "ego"), ([], "")],
)
def test_focus_is_the_first_method_that_is_no_reference(methods, focus):
    results = results_of(run_record(methods), [row(1, method, 0.1) for method in methods])
    assert results.focus == focus
