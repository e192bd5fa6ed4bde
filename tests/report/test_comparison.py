# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which method is better, by how much, and on which sweeps that was measured."""

from __future__ import annotations

import numpy as np
import pytest
from small_runs import row, run_record

from mnsf_ros.evaluation.paired import paired_difference
from mnsf_ros.evaluation.results import DROPPED, Failure, FailureKind
from mnsf_ros.report.charts import charts_of
from mnsf_ros.report.results_files import results_latex, results_markdown
from mnsf_ros.report.run_results import results_of
from mnsf_ros.report.run_tables import common_tables, differences_table, tables_of
from mnsf_ros.report.text_table import TextTable, made_table, made_tables

NOTHING = {"errors": {}, "by_range": {}, "by_speed": {}, "consistency": {}}


def sweeps(values):
    return {("street", number): value for number, value in enumerate(values)}


def test_difference_and_interval():
    random = np.random.default_rng(0)
    base = random.uniform(0.05, 0.2, 60)
    difference = paired_difference(sweeps(base), sweeps(base + random.normal(0.02, 0.01, 60)))
    assert difference.mean_m == pytest.approx(0.02, abs=0.004)
    assert difference.low_m < difference.mean_m < difference.high_m
    assert 0.001 < difference.high_m - difference.low_m < 0.01
    assert difference.verdict == "better"
    back = paired_difference(sweeps(base + 0.02), sweeps(base))
    assert (back.verdict, back.low_m, back.high_m) == ("worse", *[pytest.approx(-0.02)] * 2)


def test_sweeps_that_are_alike_make_the_interval_wider():
    random = np.random.default_rng(1)
    slow = np.repeat(random.normal(0, 0.01, 20), 10)
    mixed = random.permutation(slow)
    width = [
        found.high_m - found.low_m
        for found in (paired_difference(sweeps(0 * slow), sweeps(part)) for part in (slow, mixed))
    ]
    assert width[0] > 2 * width[1]


def test_noise_decides_nothing_and_no_common_sweep_is_none():
    random = np.random.default_rng(2)
    noise = random.normal(0, 0.01, 40)
    assert paired_difference(sweeps(np.full(40, 0.1)), sweeps(0.1 + noise)).verdict == "undecided"
    assert paired_difference(sweeps([0.1]), sweeps([0.3])).verdict == "undecided"
    assert paired_difference(sweeps([0.1]), {("other", 0): 0.2}) is None


def results(mnsf_drops=(), fnsf_fails=()):
    rows = []
    for number in range(1, 11):
        rows.append(row(number, "zero", 0.5 + 0.01 * number))
        for method, epe_m, lost, failure in (
            ("mnsf", 0.1, mnsf_drops, DROPPED),
            ("fnsf", 0.2, fnsf_fails, Failure(FailureKind.FAILED, "too few points")),
        ):
            values = {**NOTHING, "failure": failure} if number in lost else {}
            rows.append(row(number, method, epe_m + 0.01 * number, **values))
    return results_of(run_record(), rows)


def test_table_says_which_is_better_and_by_how_much():
    table = made_table(differences_table(results()))
    assert table.title.startswith("mnsf against the others")
    cells = {line[0]: line[1:] for line in table.rows}
    assert cells["fnsf, all"] == [
        "10",
        "0.155",
        "0.255",
        "+0.100",
        *cells["fnsf, all"][4:],
    ]
    assert cells["fnsf, all"][-1] == "better"
    assert set(cells) == {
        f"{m}, {g}" for m in ("fnsf", "zero") for g in ("all", "dynamic", "static")
    }


def test_methods_on_the_same_sweeps_need_no_further_table():
    assert common_tables(results()) == []


def test_drops_are_never_compared_silently():
    found = results(mnsf_drops=(1, 2, 3), fnsf_fails=(10,))
    (table,) = made_tables(common_tables(found))
    assert "the 6 of 10 that each of them answered" in table.title
    assert [line[0] for line in table.rows] == ["mnsf", "fnsf", "zero"]
    # Sweeps 4 to 9 alone.
    assert [line[1] for line in table.rows] == ["0.165", "0.265", "0.565"]
    assert made_table(differences_table(found)).rows[0][1] == "6"
    tables = tables_of(found)
    assert table.title in results_markdown(found, tables)
    assert table in tables.comparison


def test_no_sweep_in_common_is_said():
    found = results(mnsf_drops=range(1, 6), fnsf_fails=range(6, 11))
    (table,) = made_tables(common_tables(found))
    assert "the 0 of 10" in table.title
    assert table.rows == []


def test_method_under_test_is_never_a_reference():
    failed = Failure(FailureKind.FAILED, "too few points")
    rows = [row(1, "mnsf", 0.1, **NOTHING, failure=failed), row(1, "zero", 0.3)]
    found = results_of(run_record(["mnsf", "zero"]), rows)
    assert (found.focus, found.worst) == ("mnsf", [])
    assert results_of(run_record(["zero"]), [row(1, "zero", 0.3)]).focus == "zero"


def test_latex():
    table = TextTable(("method_a & b", "EPE (m)"), [["50 % {x}", "0.1"], ["a\\b", "-"]], "A_1")
    lines = table.latex().splitlines()
    assert lines[1] == r"\caption{A\_1}"
    assert lines[2] == r"\begin{tabular}{lr}"
    assert lines[4] == r"method\_a \& b & EPE (m) \\"
    assert lines[6] == r"50 \% \{x\} & 0.1 \\"
    assert lines[7] == r"a\textbackslash{}b & - \\"
    assert [line for line in lines if "rule" in line] == [r"\toprule", r"\midrule", r"\bottomrule"]


def test_latex_of_a_run_has_its_command_and_all_tables():
    found = results()
    text = results_latex(found, tables_of(found))
    assert "% mnsf evaluate street\n" in text
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") >= 5
    assert "mnsf against the others" in text


def test_difference_of_nothing_has_no_minus():
    found = [row(n, m, e) for n in range(1, 7) for m, e in (("mnsf", 0.1), ("fnsf", 0.0999))]
    table = made_table(differences_table(results_of(run_record(), found)))
    assert {line[4] for line in table.rows} == {"+0.000"}


def test_reference_that_is_better_than_a_rival_is_in_the_charts():
    found = [row(1, "mnsf", 0.01), row(1, "fnsf", 0.3), row(1, "zero", 0.1)]
    assert charts_of(results_of(run_record(), found)).not_drawn == ""
    found[1] = row(1, "fnsf", 0.05)
    assert "zero" in charts_of(results_of(run_record(), found)).not_drawn
