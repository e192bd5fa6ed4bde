# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import csv
import io
import json
import math
import resource
from contextlib import contextmanager
from dataclasses import replace

import pytest
import small_evaluations as small

import mnsf_ros
from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.results import (
    DROPPED,
    Failure,
    FailureKind,
    FinishedTask,
    ResultRow,
    mean,
    summarize,
)
from mnsf_ros.evaluation.run_folder import RunFolder, WritingError
from mnsf_ros.evaluation.run_record import RunRecord, git_commit
from mnsf_ros.presets import preset
from mnsf_ros.report.notes import NoteKind, notes_of, protocol_text
from mnsf_ros.report.results_files import results_csv, results_markdown, write_results
from mnsf_ros.report.run_results import read_results, results_of
from mnsf_ros.report.run_tables import tables_of
from mnsf_ros.report.tables import consistency_table, further_tables, main_tables
from mnsf_ros.report.text_table import made_tables

NAN = math.nan


def errors(epe_m, num_points=10):
    return FlowErrors(epe_m, 0.5, 0.6, 0.4, 0.3, num_points)


def failed(reason):
    return Failure(FailureKind.FAILED, reason)


def row(number, epe_m, method="mnsf", **changes):
    base = ResultRow(
        "drive",
        number,
        number,
        method,
        10,
        time_ms=100.0 * number,
        errors={"all": errors(epe_m), "dynamic": errors(NAN, 0), "static": errors(epe_m)},
        device="cpu",
    )
    return replace(base, **changes)


def test_value_is_the_mean_over_examples_not_over_points():
    rows = [row(1, 0.1), row(2, 0.4, errors={"all": errors(0.4, num_points=10_000)})]
    (summary,) = summarize(rows)
    assert summary.errors["all"].epe_m == pytest.approx(0.25)
    assert summary.errors["all"].num_points == 10_010
    assert summary.time_ms == 150.0
    assert summary.num_examples == 2


def test_order_of_rows_does_not_matter_to_the_last_digit():
    rows = [row(number, 1 / number) for number in range(1, 40)]
    assert summarize(rows)[0].errors["all"] == summarize(rows[::-1])[0].errors["all"]


def test_failed_and_dropped_examples_are_counted_and_in_no_mean():
    without = [ResultRow("drive", 3, 3, "mnsf", 10, failure=failed("no points"))]
    without += [ResultRow("drive", 4, 4, "mnsf", 10, failure=DROPPED)]
    (summary,) = summarize([row(1, 0.2), *without])
    assert (summary.num_examples, summary.num_failed, summary.num_dropped) == (1, 1, 1)
    assert summary.errors["all"].epe_m == 0.2
    assert summary.time_ms == 100.0


def test_methods_come_in_the_order_asked_for():
    rows = [row(1, 0.1, method) for method in ("b", "c", "a", "d")]
    assert [summary.method for summary in summarize(rows, ["c", "x", "b"])] == ["c", "b", "a", "d"]
    assert summarize([]) == []


def test_argoverse_values_are_over_all_points():
    rows = [
        row(1, 0.1, sums={"foreground dynamic": [1.0, 0.9, 0.0], "CAR/2": [1.0, 0.09, 0.1]}),
        row(2, 0.1, sums={"foreground dynamic": [9.0, 0.9, 0.0], "CAR/2": [9.0, 0.09, 0.9]}),
    ]
    (summary,) = summarize(rows)
    assert summary.three_way_epe_m["foreground dynamic"] == pytest.approx(0.18)
    assert summary.bucketed["CAR"]["dynamic"] == pytest.approx(0.18)
    assert summary.bucketed["mean"]["dynamic"] == pytest.approx(0.18)
    # Without points of all three groups there is no mean of them.
    assert math.isnan(summary.three_way_epe_m["mean"])


def test_mean_leaves_out_what_is_no_number():
    assert mean([1.0, NAN, 3.0]) == 2.0
    assert math.isnan(mean([]))


def test_tables_have_the_columns_of_the_paper():
    table, *_ = made_tables(main_tables(summarize([row(1, 0.1)])))
    assert list(table.header) == [
        "method",
        "EPE (m)",
        "Acc5 (%)",
        "Acc10 (%)",
        "Outliers (%)",
        "angle (rad)",
        "time (ms)",
    ]
    assert list(table.rows[0]) == ["mnsf", "0.100", "50.0", "60.0", "40.0", "0.300", "100"]
    assert "10 points" in table.title


def test_tables_without_content_are_left_out():
    titles = [table.title for table in made_tables(main_tables(summarize([row(1, 0.1)])))]
    assert len(titles) == 2
    assert not any("Dynamic" in title for title in titles)
    no_truth = replace(row(1, 0.1), errors={}, consistency={"nearest_m": 0.1})
    assert made_tables(main_tables(summarize([no_truth]))) == []
    (only,) = made_tables([consistency_table(summarize([no_truth]))])
    assert "needs no truth" in only.title
    (work,) = made_tables(further_tables(summarize([no_truth])))
    assert "Examples" in work.title


def test_bands_are_in_order():
    bands = {"by_range": {"inf": errors(0.5), "80": errors(0.4), "10": errors(0.1)}}
    tables = made_tables(further_tables(summarize([row(1, 0.1, **bands)])))
    (table,) = [table for table in tables if "of range" in table.title]
    assert list(table.header) == ["method", "0–10 m", "10–80 m", "80+ m"]
    assert list(table.rows[0]) == ["mnsf", "0.100", "0.400", "0.500"]


def test_csv_can_be_read_by_any_program(results):
    found, _ = results
    rows = [row(1, 0.1), row(1, 0.3, "zero", errors={})]
    found = results_of(found.record, rows)
    lines = list(csv.DictReader(io.StringIO(results_csv(found))))
    # One recording that is all there is: its lines come twice.
    assert [(line["recording"], line["method"], line["points"]) for line in lines[:4]] == [
        ("", "zero", ""),
        ("", "mnsf", "all"),
        ("", "mnsf", "dynamic"),
        ("", "mnsf", "static"),
    ]
    assert {line["recording"] for line in lines[4:]} == {"drive"}
    assert len(lines) == 8
    assert float(lines[1]["epe_m"]) == 0.1
    assert lines[0]["epe_m"] == lines[2]["epe_m"] == ""
    assert lines[0]["num_examples"] == "1"


def test_csv_has_lines_for_each_recording(results):
    found, _ = results
    rows = [row(1, 0.1), row(1, 0.3, recording="street")]
    (drive,) = found.record.recordings
    run = replace(found.record, recordings=[drive, replace(drive, name="street")])
    found = results_of(run, rows)
    lines = csv.DictReader(io.StringIO(results_csv(found)))
    values = {line["recording"]: line["epe_m"] for line in lines if line["points"] == "all"}
    assert values == {"": "0.2", "drive": "0.1", "street": "0.3"}


def test_csv_says_on_every_line_how_and_where_it_was_made(results):
    found, _ = results
    for line in csv.DictReader(io.StringIO(results_csv(found))):
        assert line["seed"] == "0"
        assert line["preset"] == "paper"
        assert "crop.max_range_m = 35.0" in line["changed_settings"]
        assert line["points_given"] == "20"
        assert line["mnsf_ros_version"] == mnsf_ros.__version__
        assert line["torch_version"]
        assert " cores" in line["machine"]
        assert line["git_commit"] == (git_commit() or "")


def test_csv_lists_what_sessions_do_not_agree_on(results):
    found, _ = results
    (first,) = found.record.sessions
    sessions = [replace(first, git_commit=commit) for commit in ("abc", "def", "abc")]
    found = replace(found, record=replace(found.record, sessions=sessions))
    line = next(csv.DictReader(io.StringIO(results_csv(found))))
    assert line["git_commit"] == "abc; def"


def test_csv_has_what_needs_no_truth(results):
    found, _ = results
    lines = list(csv.DictReader(io.StringIO(results_csv(found))))
    assert lines[0]["method"] == "zero"
    assert float(lines[0]["nearest_m"]) == float(lines[0]["zero_nearest_m"]) > 0
    assert lines[0]["cycle_m"] == ""


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Results of a small run, and where they are."""
    place = tmp_path_factory.mktemp("run")
    recording = small.recording_at(small.write_recording(place / "drive", 5))
    options = small.options({"crop.max_range_m": 35.0}, num_points=20)
    methods = small.methods_of(["zero", "ego", "mnsf"], options)
    *_, folder = small.run(place / "out", [recording], methods, options)
    found = read_results(folder)
    write_results(folder, found, tables_of(found))
    return found, folder.path


def test_files_of_results(results):
    found, path = results
    assert (path / "results.md").read_text() == results_markdown(found, tables_of(found))
    document = json.loads((path / "results.json").read_text(), parse_constant=pytest.fail)
    assert [method["method"] for method in document["methods"]] == ["zero", "ego", "mnsf"]
    assert document["methods"][1]["errors"]["static"]["epe_m"] == pytest.approx(0, abs=1e-6)
    assert document["by_recording"].keys() == {"drive"}
    assert document["run"]["options"]["num_points"] == 20
    lines = (path / "results.csv").read_text().splitlines()
    assert lines[0].startswith("recording,method,points,num_examples")


def test_markdown_says_what_the_figures_are_of(results):
    found, _ = results
    text = results_markdown(found, tables_of(found))
    for part in (
        "mean over 3 examples from 1 recording",
        "20 random points of each sweep, the same for all methods",
        "without ground (flag in the truth",
        "Settings: mnsf: preset paper with crop.max_range_m = 35.0, ",
        ", warm start off.",
        "on cpu with 1 thread",
        "git commit",
        "machine:",
        "| method | EPE (m) | Acc5 (%) |",
    ):
        assert part in text


def test_differing_numbers_of_examples_and_time_budgets_are_told(results):
    found, _ = results
    summaries = [
        replace(found.summaries[0], num_examples=2, num_failed=1),
        replace(found.summaries[1], stop_reasons={"time_budget": 4}),
    ]
    text = " ".join(protocol_text(found.record, summaries, found.used_settings))
    assert "over 2 to 3 examples" in text
    assert "Examples without a flow, not in any mean: 1" in text
    assert "Methods differ in the number of examples" in text
    assert "4 optimizations reached their time budget" in text


def test_notes_tell_damage_missing_truth_and_what_was_noticed(results):
    found, _ = results
    (drive,) = found.record.recordings
    drive = replace(drive, damages=["a.mcap, byte 7: cut"], truth=None)
    run = replace(found.record, recordings=[drive])
    counts = {"sweeps_read": 5, "sweeps read": 5, "gaps": 2, "an event of an old run": 3}
    task = FinishedTask("drive", "ego", 3, counts, ["b: c"])
    notes = notes_of(run, [task] * 2)
    assert [(note.kind, note.text) for note in notes] == [
        (NoteKind.DAMAGE, "Damage: a.mcap, byte 7: cut"),
        (NoteKind.DAMAGE, "Damage: b: c"),
        (NoteKind.NO_TRUTH, "drive: no true flow, so no errors."),
        (NoteKind.EVENT, f"drive: {Event.GAPS.text}: 2."),
        (NoteKind.EVENT, "drive: an event of an old run: 3."),
    ]


@pytest.mark.parametrize(
    ("cycles", "columns"), [([{}, {}], 3), ([{}, {"cycle_m": 0.1}], 4), ([{"cycle_m": 0.0}] * 2, 4)]
)
def test_way_back_has_a_column_only_where_somebody_went_it(cycles, columns):
    rows = [
        replace(row(1, 0.1, method), consistency={"nearest_m": 0.2, "zero_nearest_m": 0.3, **cycle})
        for method, cycle in zip(("zero", "mnsf"), cycles, strict=True)
    ]
    (table,) = made_tables([consistency_table(summarize(rows, ["zero", "mnsf"]))])
    assert len(table.header) == columns
    assert ("there and back (m)" in table.header) == (columns == 4)


def test_notes_name_many_recordings_in_one_line(results):
    found, _ = results
    one = replace(found.record.recordings[0], has_checksums=False, truth=None)
    bags = [replace(one, name=f"bag_{number}") for number in range(6)]
    checksums, truth = notes_of(replace(found.record, recordings=bags), [])
    assert (checksums.kind, truth.kind) == (NoteKind.NO_CHECKSUMS, NoteKind.NO_TRUTH)
    for note in (checksums, truth):
        assert note.text.startswith("bag_0, bag_1, bag_2, bag_3 and 2 more: no ")


def test_notes_say_why_methods_gave_no_flow(results):
    found, _ = results
    rows = [
        row(1, 0.1),
        row(2, 0.1, failure=DROPPED),
        row(3, 0.1, "ego", failure=failed("there is no odometry.")),
        row(4, 0.1, "ego", failure=failed("something else")),
        row(5, 0.1, "ego"),
    ]
    (note,) = notes_of(found.record, [], rows)
    expected = "ego: examples without a flow: 2; the first, sweep 3 of drive: there is no odometry."
    assert (note.kind, note.text) == (NoteKind.FAILURES, expected)


def test_method_that_never_gave_a_flow_is_told(results):
    found, _ = results
    rows = [
        row(1, 0.1, failure=DROPPED),
        row(1, 0.1, "ego", failure=failed("no odometry")),
        row(2, 0.1, "ego", failure=DROPPED),
        row(1, 0.1, "fnsf"),
        row(1, 0.1, "fnsf", recording="street", failure=failed("no points")),
        row(2, 0.1, "fnsf", recording="street", failure=failed("no points")),
    ]
    notes = [note for note in notes_of(found.record, [], rows) if note.kind.is_incomplete]
    assert {note.kind for note in notes} == {NoteKind.NO_FLOW}
    assert [note.text for note in notes] == [
        "No flow: ego failed on every example of drive: 1.",
        "No flow: fnsf failed on every example of street: 2.",
    ]


def test_rows_of_sessions_that_differ_are_told(results):
    found, _ = results
    (first,) = found.record.sessions
    second = replace(
        first,
        git_commit="def",
        versions=first.versions | {"torch": "0.1"},
        machine=replace(first.machine, name="other"),
    )

    def notes_about(*sessions):
        notes = notes_of(replace(found.record, sessions=list(sessions)), [])
        return [note.text for note in notes if note.kind is NoteKind.MIXED_SESSIONS]

    assert notes_about(first, first) == []
    torch, name = first.versions["torch"], first.machine.name
    assert notes_about(replace(first, git_commit="abc"), second) == [
        "Rows of 2 sessions with different git commits: abc, def.",
        f"Rows of 2 sessions with different machines: {name}, other.",
        f"Rows of 2 sessions with different versions of torch: {torch}, 0.1.",
    ]


@contextmanager
def small_disk(num_bytes):
    """No file can get larger than this, as on a disk that is full."""
    limits = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (num_bytes, limits[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, limits)


def test_full_disk_costs_no_earlier_results(results):
    found, path = results
    names = ("results.md", "results.csv", "results.json")
    before = {name: (path / name).read_bytes() for name in names}
    with pytest.raises(WritingError, match=r"results\.md: cannot be written: "), small_disk(100):
        write_results(RunFolder(path), found, tables_of(found))
    assert {name: (path / name).read_bytes() for name in names} == before
    assert not [file for file in path.iterdir() if file.name.endswith(".new")]


@pytest.mark.parametrize(
    ("preset_name", "changes"),
    [("paper", {}), ("online", {}), ("paper", {"crop.max_range_m": 35.0, "ground.remove": False})],
)
def test_settings_are_told_by_the_nearest_preset(preset_name, changes):
    known = EvaluationOptions(preset(preset_name).changed(changes))
    used = RunRecord(known, [], [], []).used_settings(known.settings.method.name)
    assert used == (known.settings, preset_name, changes)


@pytest.mark.parametrize(
    ("ground", "truths", "said"),
    [
        ("truth", ["/t", "/t"], "without ground (flag in the truth);"),
        ("truth", ["/t", None], "flag in the truth, height map where there is no truth);"),
        ("truth", [None], "without ground (height map);"),
        ("settings", ["/t"], "without ground (height map);"),
    ],
)
def test_it_is_told_what_the_ground_was_known_from(results, ground, truths, said):
    found, _ = results
    (one,) = found.record.recordings
    run = replace(
        found.record,
        options=replace(found.record.options, ground=ground),
        recordings=[replace(one, truth=truth) for truth in truths],
    )
    assert said in " ".join(protocol_text(run, found.summaries, found.used_settings))


def test_settings_are_told_of_each_method(results):
    found, _ = results
    (first, *others) = found.summaries
    settings = preset("paper").changed({"objects.min_probability": 0.4})
    run = replace(found.record, options=replace(found.record.options, settings=settings))
    changed = "objects.min_probability = 0.4"
    used = {name: run.used_settings(name) for name in ("online", *run.method_names)}
    text = " ".join(protocol_text(run, [replace(first, method="online"), *others], used))
    assert (
        f"Settings: online: preset online with {changed}, warm start on; "
        f"mnsf: preset paper with {changed}, warm start off."
    ) in text
    references = [one for one in found.summaries if one.method in run.references]
    text = " ".join(protocol_text(run, [replace(first, method="online"), *references], used))
    assert f"Settings: online: preset online with {changed}, warm start on. " in text
    summaries = [replace(first, method="online"), *others]
    told = replace(found, record=run, used_settings=used, summaries=summaries)
    lines = list(csv.DictReader(io.StringIO(results_csv(told))))
    presets = {line["method"]: line["preset"] for line in lines if not line["recording"]}
    assert (presets["online"], presets["mnsf"]) == ("online", "paper")
