# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Summaries of rows: means over examples, counts, and errors over all points."""

import math
from dataclasses import replace

import pytest

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.scoring import DROPPED, ResultRow
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.report.tables import further_tables

NAN = math.nan


def errors(epe_m, num_points=10):
    return FlowErrors(epe_m, 0.5, 0.6, 0.4, 0.3, num_points)


def row(number, epe_m, method="mnsf", **changes):
    base = ResultRow(
        *("drive", number, number, method, 10),
        time_ms=100.0 * number,
        errors={"all": errors(epe_m), "dynamic": errors(NAN, 0), "static": errors(epe_m)},
    )
    return replace(base, **changes)


def test_value_is_the_mean_over_examples_not_over_points():
    rows = [row(1, 0.1), row(2, 0.4, errors={"all": errors(0.4, num_points=10_000)})]
    (summary,) = (line for _, line in summarize(rows).iterrows())
    assert summary["errors.all.epe_m"] == pytest.approx(0.25)
    assert summary["errors.all.num_points"] == 10_010
    assert summary["time_ms"] == 150.0
    assert summary["num_examples"] == 2
    assert summarize([]).empty


def test_order_of_rows_does_not_matter_to_the_last_digit():
    rows = [row(number, 1 / number) for number in range(1, 40)]
    assert summarize(rows).equals(summarize(rows[::-1]))


def test_failed_and_dropped_examples_are_counted_and_in_no_mean():
    failed = "no points"
    without = [row(3, 9.0, failure=failed), row(4, 9.0, failure=DROPPED)]
    summary = summarize([row(1, 0.2), *without, row(1, 0.1, "ego", failure=failed)])
    counts = summary[["num_examples", "num_failed", "num_dropped"]]
    assert counts.loc["mnsf"].tolist() == [1, 1, 1]
    assert counts.loc["ego"].tolist() == [0, 1, 0]
    assert summary.at["mnsf", "errors.all.epe_m"] == 0.2
    assert summary.at["mnsf", "time_ms"] == 100.0
    assert math.isnan(summary.at["ego", "time_ms"])


def test_lost_ego_motion_is_counted():
    rows = [row(1, 0.1, lost="clouds repeat"), row(2, 0.3)]
    summary = summarize(rows).loc["mnsf"]
    assert (summary["num_lost"], summary["num_examples"]) == (1, 2)
    assert summary["errors.all.epe_m"] == pytest.approx(0.2)


def test_methods_come_in_the_order_asked_for():
    rows = [row(1, 0.1, method) for method in ("b", "c", "a", "d")]
    assert list(summarize(rows, ["c", "x", "b"]).index) == ["c", "b", "a", "d"]


def test_starts_and_time_budgets_are_counted():
    rows = [row(1, 0.1, start="cold"), row(2, 0.1, start="warm")]
    rows += [row(3, 0.1, start="warm", stop_reasons={"a": "time_budget", "b": "converged"})]
    assert summarize(rows)[["num_warm", "num_out_of_time"]].to_numpy().tolist() == [[2, 1]]


def test_work_is_the_last_table():
    (work,) = further_tables(summarize([row(1, 0.1)]))
    assert work.rows == [["mnsf", "1", "0", "0", "0", "100", "-", "0", "0"]]
