# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Results of a run: which method is better, on which sweeps, what is worst, and their files."""

from __future__ import annotations

import csv
import io
import json
import resource
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from small_runs import NOTHING, dropped, failed, recording, row, rows, run_record, session

from mnsf_ros.evaluation.comparison import differences, verdict
from mnsf_ros.evaluation.movers import MoverRow, ObjectRow
from mnsf_ros.evaluation.run_folder import RunFolder, WritingError
from mnsf_ros.evaluation.summary import row_table
from mnsf_ros.report.page import stage_times_ms
from mnsf_ros.report.results_files import (
    results_csv,
    results_latex,
    results_markdown,
    write_results,
)
from mnsf_ros.report.run_results import results_of


def difference(under_test, other):
    pairs = {"mnsf": under_test, "fnsf": other}
    found = [row(n, m, e) for m, values in pairs.items() for n, e in enumerate(values)]
    return differences(row_table(found), "mnsf", ["fnsf"]).loc[("fnsf", "all")]


def test_difference_and_interval():
    random = np.random.default_rng(0)
    base = random.uniform(0.05, 0.2, 60)
    found = difference(base, base + random.normal(0.02, 0.01, 60))
    assert found["mean_m"] == pytest.approx(0.02, abs=0.004)
    assert found["low_m"] < found["mean_m"] < found["high_m"]
    assert 0.001 < found["high_m"] - found["low_m"] < 0.01
    assert verdict(found) == "better"
    back = difference(base + 0.02, base)
    assert verdict(back) == "worse"
    assert (back["low_m"], back["high_m"]) == (pytest.approx(-0.02), pytest.approx(-0.02))
    noise = random.normal(0, 0.01, 40)
    assert verdict(difference(np.full(40, 0.1), 0.1 + noise)) == "undecided"
    assert verdict(difference([0.1], [0.3])) == "undecided"
    # Consecutive sweeps that are alike make the interval wider.
    slow = np.repeat(random.normal(0, 0.01, 20), 10)
    both = [difference(0 * slow, part) for part in (slow, random.permutation(slow))]
    alike, mixed = (one["high_m"] - one["low_m"] for one in both)
    assert alike > 2 * mixed


def compared(mnsf_drops=(), fnsf_fails=()):
    found = []
    for n in range(1, 11):
        found.append(row(n, "zero", 0.5 + 0.01 * n))
        found.append(dropped(n, "mnsf") if n in mnsf_drops else row(n, "mnsf", 0.1 + 0.01 * n))
        lost = failed(n, "fnsf", "too few points")
        found.append(lost if n in fnsf_fails else row(n, "fnsf", 0.2 + 0.01 * n))
    return results_of(run_record(), found)


def test_table_says_which_is_better_and_by_how_much():
    (table,) = compared().tables.comparison
    assert table.title.startswith("mnsf against the others")
    assert table.rows[0][:5] == ("fnsf, all", "10", "0.155", "0.255", "+0.100")
    assert table.rows[0][-1] == "better"
    groups = ("all", "dynamic", "static")
    assert [line[0] for line in table.rows] == [
        f"{m}, {g}" for m in ("fnsf", "zero") for g in groups
    ]
    # A difference that is rounded to nothing has no minus.
    found = [row(n, m, e) for n in range(1, 7) for m, e in (("mnsf", 0.1), ("fnsf", 0.0999))]
    (table,) = results_of(run_record(), found).tables.comparison
    assert {line[4] for line in table.rows} == {"+0.000"}


def test_methods_that_answered_different_sweeps_are_compared_on_common_ones():
    found = compared(mnsf_drops=(1, 2, 3), fnsf_fails=(10,))
    common, paired = found.tables.comparison
    assert "the 6 of 10 that each of them answered" in common.title
    assert [line[0] for line in common.rows] == ["mnsf", "fnsf", "zero"]
    # Sweeps 4 to 9 alone.
    assert [line[1] for line in common.rows] == ["0.165", "0.265", "0.565"]
    assert paired.rows[0][1] == "6"
    assert common.title in results_markdown(found)
    found = compared(mnsf_drops=range(1, 6), fnsf_fails=range(6, 11))
    common, *_ = found.tables.comparison
    assert "the 0 of 10" in common.title
    assert common.rows == []


@pytest.mark.parametrize(
    ("methods", "focus"),
    [(["zero", "fnsf", "mnsf"], "fnsf"), (["zero", "fnsf"], "fnsf"), (["ego"], "ego"), ([], "")],
)
def test_focus_is_the_first_method_that_is_no_reference(methods, focus):
    results = results_of(run_record(methods), [row(1, method, 0.1) for method in methods])
    assert results.focus == focus


def test_worst_is_by_error_and_without_truth_by_distance():
    def worst(found):
        return results_of(run_record(["a"]), found).worst["number"].tolist()

    assert worst([row(n, "a", e) for n, e in ((1, 0.1), (2, 0.3), (3, 0.2))]) == [2, 3, 1]
    near, far = ({**NOTHING, "consistency": {"nearest_m": d}} for d in (0.1, 0.4))
    blind = [row(1, "a", 0, **near), row(2, "a", 0, **far), row(3, "a", 0, **NOTHING)]
    assert worst([*blind, dropped(4, "a")]) == [2, 1]
    assert worst([failed(1, "a", "no points")]) == []


def test_movers_that_were_missed_most_often_come_first():
    def missed(numbers, *, found=0.0, focus=None):
        items = [ObjectRow(who, "car", True, 5.0, 10.0, 50, found) for who in numbers]
        rows = [
            row(number, "mnsf", 0.1, movers=MoverRow((1, 0, 0), 0, objects=[item]))
            for number, item in enumerate(items)
        ]
        tables = results_of(run_record(), rows, focus=focus).tables.missed
        return [line[:3] for table in tables for line in table.rows]

    assert missed([1, 2, 2, 1, 2]) == [
        ("street: car", "3", "1.000"),
        ("street: car", "2", "0.000"),
    ]
    assert missed([1, 2], focus="fnsf") == missed([1], found=1.0) == []


def test_time_outside_of_all_stages_is_shown():
    times_ms = stage_times_ms(row_table(rows()))
    assert times_ms["mnsf"] == pytest.approx({"prepare": 10.0, "forward": 60.0, "other": 30.0})


def csv_lines(results):
    return list(csv.DictReader(io.StringIO(results_csv(results))))


def test_csv_has_a_line_for_each_method_and_group_of_points_of_each_recording():
    unscored = row(1, "zero", 0, **NOTHING, recording="drive")
    found = [row(1, "mnsf", 0.1), row(2, "mnsf", 0.3, recording="drive"), unscored]
    record = run_record(recordings=[recording("street"), recording("drive")])
    lines = csv_lines(results_of(record, found))
    groups = ["all", "dynamic", "static", *(f"range up to {x} m" for x in ("10", "80", "inf"))]
    groups += ["speed up to 0.5 m/s", "speed up to 2 m/s"]
    keys = [(line["recording"], line["method"], line["points"]) for line in lines]
    assert keys == [
        *(("", "mnsf", group) for group in groups),
        ("", "zero", ""),
        *(("street", "mnsf", group) for group in groups),
        *(("drive", "mnsf", group) for group in groups),
        ("drive", "zero", ""),
    ]
    values = {line["recording"]: line["epe_m"] for line in lines if line["points"] == "all"}
    assert values == {"": "0.2", "street": "0.1", "drive": "0.3"}
    first, empty = lines[0], lines[len(groups)]
    assert (first["num_points"], first["num_examples"], first["time_ms"]) == ("20", "2", "100.0")
    assert (empty["epe_m"], empty["num_examples"], empty["precision"]) == ("", "1", "")
    assert first["nearest_m"] == "0.25"


def test_csv_has_the_settings_and_the_machine_of_all_sessions_on_every_line():
    sessions = [session({"git commit": commit}) for commit in ("abc", "def", "abc")]
    settings = run_record().options.settings.changed({"crop.max_range_m": 35.0})
    record = run_record(sessions=sessions)
    record = replace(record, options=replace(record.options, settings=settings))
    for line in csv_lines(results_of(record, rows())):
        assert (line["seed"], line["preset"], line["points_given"]) == ("7", "paper", "2048")
        assert line["changed_settings"] == "crop.max_range_m = 35.0"
        assert (line["mnsf_ros_version"], line["torch_version"]) == ("1.0", "2.0")
        assert line["machine"] == "box, fast, 2 cores"
        assert line["git_commit"] == "abc; def"


def test_columns_of_csv_keep_their_places():
    assert results_csv(results_of(run_record(), rows())).splitlines()[0] == (
        "recording,method,points,num_examples,num_failed,num_dropped,epe_m,acc5,acc10,outliers,"
        "angle_error_rad,num_points,time_ms,latency_ms,nearest_m,zero_nearest_m,cycle_m,seed,"
        "preset,changed_settings,num_threads,points_given,ground,realtime_rate,every,"
        "mnsf_ros_version,torch_version,machine,git_commit,precision,recall,iou,ghosts_per_sweep,"
        "ghost_sweeps,velocity_error_m_s,direction_error_deg,after_stop_s,fast_found,fast_flicker,"
        "fast_delay_s,slow_found,slow_flicker,slow_delay_s"
    )


def test_files_of_results(tmp_path):
    found = results_of(run_record(), rows())
    write_results(RunFolder(tmp_path), found)
    text = (tmp_path / "results.md").read_text()
    assert text == results_markdown(found)
    for part in ("Unweighted mean over 3 examples", "* git commit: abc123", "| method | EPE (m) |"):
        assert part in text
    document = json.loads((tmp_path / "results.json").read_text(), parse_constant=pytest.fail)
    assert [line["method"] for line in document["methods"]] == ["mnsf", "fnsf", "zero"]
    assert document["methods"][0]["errors.static.epe_m"] == pytest.approx(0.2)
    assert document["by_recording"].keys() == {"street"}
    assert document["run"]["options"]["num_points"] == 2048
    text = results_latex(found)
    assert "% mnsf evaluate street\n" in text
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") == len(found.tables.listed)


@contextmanager
def small_disk(num_bytes):
    """No file can get larger than this, as on a disk that is full."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_full_disk_costs_no_earlier_results(tmp_path):
    found = results_of(run_record(), rows())
    write_results(RunFolder(tmp_path), found)
    before = {path: path.read_bytes() for path in tmp_path.iterdir()}
    with pytest.raises(WritingError, match=r"results\.md: cannot be written: "), small_disk(100):
        write_results(RunFolder(tmp_path), found)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
