# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Results of a run: what is worst, what was missed, and their files."""

import csv
import io
import resource
from contextlib import contextmanager
from dataclasses import replace

import pytest
from small_runs import NOTHING, dropped, failed, recording, row, rows, run_record, session

from mnsf_ros.evaluation.movers import MoverRow, ObjectRow
from mnsf_ros.evaluation.run_folder import RunFolder, StoppedError
from mnsf_ros.report.results_files import (
    results_csv,
    results_markdown,
    write_results,
)
from mnsf_ros.report.run_results import results_of
from mnsf_ros.report.tables import missed_tables


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
    def missed(numbers, *, found=0.0, method="mnsf"):
        items = [ObjectRow(who, "car", True, 5.0, 10.0, 50, found) for who in numbers]
        rows = [
            row(number, "mnsf", 0.1, movers=MoverRow((1, 0, 0), 0, objects=[item]))
            for number, item in enumerate(items)
        ]
        return [line[:3] for table in missed_tables(rows, method) for line in table.rows]

    assert missed([1, 2, 2, 1, 2]) == [
        ("street: car", "3", "1.000"),
        ("street: car", "2", "0.000"),
    ]
    assert missed([1, 2], method="fnsf") == missed([1], found=1.0) == []


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
        "angle_error_rad,num_points,time_ms,latency_ms,nearest_m,zero_nearest_m,seed,"
        "preset,changed_settings,num_threads,points_given,ground,realtime_rate,every,"
        "mnsf_ros_version,torch_version,machine,git_commit,precision,recall,iou,ghosts_per_sweep,"
        "ghost_sweeps,velocity_error_m_s,direction_error_deg,after_stop_s,fast_found,fast_flicker,"
        "fast_delay_s,slow_found,slow_flicker,slow_delay_s,num_lost"
    )


def test_text_of_others_has_no_tags_in_markdown():
    bad = "command:<script>alert(1)</script>"
    run = run_record([bad], recordings=[recording(bad)], sessions=[session({"machine": bad})])
    text = results_markdown(results_of(run, [row(1, bad, 0.1), failed(2, bad, bad)]))
    assert "<" not in text
    assert f"* machine: {bad.replace('<', '&lt;')}" in text


def test_files_of_results(tmp_path):
    found = results_of(run_record(), rows())
    write_results(RunFolder(tmp_path), found)
    text = (tmp_path / "results.md").read_text()
    assert text == results_markdown(found)
    for part in ("Unweighted mean over 3 examples", "* git commit: abc123", "| method | EPE (m) |"):
        assert part in text
    text = (tmp_path / "results.tex").read_text()
    assert "% mnsf evaluate street\n" in text
    num_tables = len(found.main_tables) + len(found.further_tables)
    assert text.count(r"\begin{table}") == text.count(r"\end{table}") == num_tables


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
    with pytest.raises(StoppedError, match=r"results\.md: cannot be written: "), small_disk(100):
        write_results(RunFolder(tmp_path), found)
    assert {path: path.read_bytes() for path in tmp_path.iterdir()} == before
