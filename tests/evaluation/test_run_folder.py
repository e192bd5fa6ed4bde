# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import math
import os
import re
from dataclasses import replace

import pytest
import small_evaluations as small

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.recordings import path_text
from mnsf_ros.evaluation.results import DROPPED, Failure, FailureKind, ResultRow
from mnsf_ros.evaluation.run_files import WritingError, check_folder, locked, replace_file
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_json import from_json, to_json
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.report.notes import NoteKind
from mnsf_ros.report.run_results import read_results

NAN = math.nan
ERRORS = FlowErrors(0.1, 0.2, 0.3, 0.4, 0.5, 6)
NO_ERRORS = FlowErrors(NAN, NAN, NAN, NAN, NAN, 0)


def full_row(number=3, method="mnsf", recording="drive"):
    return ResultRow(
        recording=recording,
        number=number,
        stamp_ns=1_700_000_000_123_456_789,
        method=method,
        num_points=8192,
        time_ms=0.1 + 0.2,
        stage_times_ms={"forward": 1 / 3},
        stop_reasons={"forward": "converged"},
        iterations={"forward": 31},
        errors={"all": ERRORS, "dynamic": NO_ERRORS},
        by_range={"10": ERRORS},
        by_speed={"inf": ERRORS},
        three_way_epe_m={"foreground dynamic": NAN, "background static": 0.5},
        bucketed={"CAR": {"dynamic": NAN, "static": 0.1}},
        sums={"CAR/0": [3.0, 0.3, 0.0]},
        consistency={"nearest_m": 0.25},
        start="warm",
        device="cpu",
    )


def test_row_comes_back_to_the_last_digit():
    row = full_row()
    line = to_json(row)
    assert "\n" not in line
    again = from_json(line, ResultRow)
    # NaN is not equal to itself, so texts are compared.
    assert to_json(again) == line
    assert again.errors["all"] == ERRORS
    assert again.time_ms == row.time_ms
    assert again.stamp_ns == row.stamp_ns
    assert math.isnan(again.latency_ms)
    assert math.isnan(again.errors["dynamic"].epe_m)
    assert again.sums == row.sums


def test_row_is_json_for_every_program():
    values = json.loads(to_json(full_row()), parse_constant=pytest.fail)
    assert values["latency_ms"] is None
    assert values["errors"]["dynamic"]["epe_m"] is None


def test_failed_row_comes_back():
    failure = Failure(FailureKind.FAILED, "no points: «ä»")
    row = ResultRow("drive", 1, 2, "mnsf", 0, failure=failure)
    assert from_json(to_json(row), ResultRow).failure == failure


@pytest.mark.parametrize(
    "line",
    ["", "x", "[]", "1", "{}", '{"recording": "a"}', '{"colour": 1}', '{"errors": 3}', "\x00\x00"],
)
def test_what_is_no_row_is_refused(line):
    with pytest.raises(EvaluationError, match="is not a result row"):
        from_json(line, ResultRow)


@pytest.mark.parametrize("depth", [*range(100, 1000, 20), 200_000])
def test_what_is_nested_deeply_is_refused(depth):
    with pytest.raises(EvaluationError, match="is not a result row"):
        from_json(f'{{"recording": {"[" * depth}{"]" * depth}}}', ResultRow)


@pytest.fixture
def folder(tmp_path):
    return RunFolder(tmp_path)


def test_rows_are_there_as_soon_as_they_are_written(folder):
    for number in range(3):
        folder.add_row(full_row(number))
        assert [row.number for row in folder.rows] == list(range(number + 1))


def test_line_that_was_being_written_is_lost_but_no_other(tmp_path, recording):
    folder = start(tmp_path / "out", recording)
    for number in range(3):
        folder.add_row(full_row(number))
    file = folder.path / "rows.jsonl"
    file.write_text(file.read_text()[:-40])
    assert [row.number for row in folder.rows] == [0, 1]
    folder = start(folder.path, recording, resume=True)
    folder.add_row(full_row(2))
    assert [row.number for row in folder.rows] == [0, 1, 2]


def test_damaged_line_is_named(folder):
    folder.add_row(full_row())
    with (folder.path / "rows.jsonl").open("a") as file:
        file.write("rubbish\n")
    with pytest.raises(EvaluationError, match=r"rows\.jsonl, line 2: is not a result row"):
        list(folder.rows)


def test_rows_of_a_task_can_be_dropped(folder):
    for method in ("mnsf", "fnsf"):
        for number in range(2):
            folder.add_row(full_row(number, method))
    folder.drop([("drive", "mnsf"), ("other", "fnsf")])
    assert [(row.method, row.number) for row in folder.rows] == [("fnsf", 0), ("fnsf", 1)]


def test_finished_tasks_come_back(tmp_path, recording):
    findings = Findings()
    findings.count(Event.SWEEPS_READ, 6)
    with RunFolder(tmp_path / "out").opened(resume=False) as folder:
        (task,) = folder.begin(record_of(recording))
        assert folder.finished() == {}
        folder.take(task, full_row(1, "ego"))
        folder.take(task, findings)
    known = folder.finished()["drive", "ego"]
    assert known.num_examples == 1
    assert known.counts == {"sweeps_read": 6}
    (folder.path / "tasks.jsonl").write_text("{}\n")
    with pytest.raises(EvaluationError, match="line 1: is not a finished task"):
        folder.finished()


def test_two_processes_cannot_write_to_the_same_folder(folder):
    refused = pytest.raises(EvaluationError, match="another process")
    with locked(folder.path), refused, locked(folder.path):
        pass
    with locked(folder.path):
        pass


def test_folder_in_which_nothing_happened_is_taken_away(tmp_path, recording):
    with RunFolder(tmp_path / "out").opened(resume=False) as folder:
        assert not (tmp_path / "out").exists(), "nothing is written before the run begins"
        folder.begin(record_of(recording))
        assert not folder.has_results
    assert not (tmp_path / "out").exists()
    with RunFolder(tmp_path / "out").opened(resume=False) as folder:
        folder.begin(record_of(recording))
        folder.add_row(full_row())
    assert len(list(folder.rows)) == 1


def test_run_that_was_killed_while_it_was_written_down_is_started_anew(tmp_path, recording):
    out = tmp_path / "out"
    out.mkdir()
    for name in (".lock", ".run.json.new"):
        (out / name).write_text("{")
    with RunFolder(out).opened(resume=True) as folder:
        folder.begin(record_of(recording))
    assert not out.exists()
    out.mkdir()
    (out / ".run.json.new").write_text("{")
    assert start(out, recording).read_record().recordings
    assert not (out / ".run.json.new").exists()


def test_run_that_another_process_made_meanwhile_is_left_alone(tmp_path, recording):
    refused = pytest.raises(EvaluationError, match="another process has just written to it")
    with RunFolder(tmp_path / "out").opened(resume=False) as folder:
        start(tmp_path / "out", recording)
        before = (tmp_path / "out" / "run.json").read_bytes()
        with refused:
            folder.begin(record_of(recording))
    with RunFolder(tmp_path / "out").opened(resume=True) as folder:
        start(tmp_path / "out", recording, resume=True, methods=("zero",))
        with refused:
            folder.begin(record_of(recording))
    assert before != (tmp_path / "out" / "run.json").read_bytes()


def test_run_of_another_process_is_not_resumed(tmp_path, recording):
    folder = start(tmp_path / "out", recording)
    folder.add_row(full_row())
    with (folder.path / "rows.jsonl").open("a") as file:
        file.write("half a li")
    before = {file: file.read_bytes() for file in folder.path.iterdir()}
    with locked(folder.path), pytest.raises(EvaluationError, match="another process"):
        start(tmp_path / "out", recording, resume=True)
    assert {file: file.read_bytes() for file in folder.path.iterdir()} == before


@pytest.fixture
def recording(tmp_path):
    return small.recording_at(small.write_recording(tmp_path / "bags" / "drive", 3))


def record_of(recording, options=None, methods=("ego",)):
    options, methods = options or small.options(), small.methods_of(methods)
    return RunRecord(options, methods, [recording], [small.SESSION])


def start(out, recording, options=None, *, resume=False, methods=("ego",)):
    options, methods = options or small.options(), small.methods_of(methods)
    return small.begun(out, [recording], methods, options, resume=resume)


def test_run_tells_what_it_was(tmp_path, recording):
    run = start(
        tmp_path / "new" / "out", recording, small.options(num_points=10, seed=4)
    ).read_record()
    options = run.options
    assert options.seed == options.settings.compute.seed == 4
    assert options.num_points == 10
    assert options.settings.field.hidden_width == 4
    assert run.method_names == ["ego"]
    assert run.references == {"ego"}
    assert run.recordings[0].name == "drive"
    (session,) = run.sessions
    assert session.command == ["mnsf"]
    assert {"torch", "numpy", "mnsf_ros", "python"} <= session.versions.keys()
    assert session.machine.cores >= 1
    assert json.loads((tmp_path / "new/out/run.json").read_text())["sessions"][0]["git_commit"] == (
        session.git_commit
    )


def test_existing_folder_is_not_overwritten(tmp_path, recording):
    out = tmp_path / "out"
    start(out, recording)
    before = (out / "run.json").read_text()
    with pytest.raises(EvaluationError, match="exists already; name another folder, or add"):
        start(out, recording)
    assert (out / "run.json").read_text() == before
    # Not even one that never was a run.
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "text.txt").write_text("mine")
    with pytest.raises(EvaluationError, match="exists already"):
        start(tmp_path / "notes", recording)
    with pytest.raises(EvaluationError, match="holds no run"):
        start(tmp_path / "notes", recording, resume=True)


def test_file_in_the_place_of_the_folder(tmp_path):
    (tmp_path / "out").write_text("x")
    for resume in (False, True):
        with pytest.raises(EvaluationError, match="is not a folder"):
            check_folder(tmp_path / "out", resume=resume)


def test_empty_folder_and_resume_of_nothing_just_start(tmp_path, recording):
    (tmp_path / "out").mkdir()
    start(tmp_path / "out", recording)
    start(tmp_path / "other", recording, resume=True)
    assert (tmp_path / "other" / "run.json").exists()


@pytest.mark.parametrize(
    ("changes", "text"),
    [
        ({"options": small.options(num_points=9)}, "num_points was None, is 9"),
        ({"options": small.options(seed=1)}, "seed was 0, is 1"),
        (
            {"options": small.options({"crop.max_range_m": 30.0})},
            "crop.max_range_m was 80.0, is 30.0",
        ),
        ({"options": small.options(realtime_rate=1.0)}, "realtime_rate was None, is 1.0"),
    ],
)
def test_other_settings_are_not_mixed(tmp_path, recording, changes, text):
    out = tmp_path / "out"
    start(out, recording)
    with pytest.raises(EvaluationError, match="with other settings") as caught:
        start(out, recording, resume=True, **changes)
    assert text in str(caught.value)


def test_other_preset_is_told_by_a_few_of_its_settings(tmp_path, recording):
    start(tmp_path / "out", recording)
    online = small.EvaluationOptions(small.preset("online"))
    with pytest.raises(EvaluationError, match=r"; and \d+ more$") as caught:
        start(tmp_path / "out", recording, online, resume=True)
    assert str(caught.value).count(" was ") == 5


def test_resumed_run_may_have_more_methods_and_recordings(tmp_path, recording):
    out = tmp_path / "out"
    start(out, recording)
    start(out, replace(recording, name="other"), resume=True, methods=["zero", "ego"])
    run = RunFolder(out).read_record()
    assert run.method_names == ["ego", "zero"]
    assert [item.name for item in run.recordings] == ["drive", "other"]
    assert len(run.sessions) == 2


def test_another_recording_of_the_same_name_is_refused(tmp_path, recording):
    start(tmp_path / "out", recording)
    with pytest.raises(EvaluationError, match=r"another recording 'drive': truth was .*is None"):
        start(tmp_path / "out", replace(recording, truth=None), resume=True)


def test_another_recording_of_the_same_size_and_topics_is_refused(tmp_path):
    one = small.recording_at(small.write_recording(tmp_path / "a" / "drive", 3))
    other = small.recording_at(small.write_recording(tmp_path / "b" / "drive", 3, num_points=61))
    start(tmp_path / "out", one)
    before = (tmp_path / "out" / "run.json").read_text()
    with pytest.raises(EvaluationError, match="another recording 'drive': fingerprint: ") as caught:
        start(tmp_path / "out", other, resume=True)
    assert re.search(r"num_bytes was \d+, is \d+", str(caught.value))
    assert "\n" not in str(caught.value)
    assert (tmp_path / "out" / "run.json").read_text() == before


def test_recording_that_has_moved_is_the_same(tmp_path):
    bag = small.write_recording(tmp_path / "a" / "drive", 3)
    start(tmp_path / "out", small.recording_at(bag))
    moved = bag.rename(tmp_path / "drive")
    start(tmp_path / "out", small.recording_at(moved), resume=True)
    (known,) = RunFolder(tmp_path / "out").read_record().recordings
    assert known.path == str(moved)


def old_run(folder):
    """Writes the files of a run as early versions did."""
    run = small.old_run_record(json.loads((folder.path / "run.json").read_text()))
    del run["recordings"][0]["fingerprint"]
    (folder.path / "run.json").write_text(json.dumps(run))
    failures = ("", "no points", "dropped: a newer triplet took its place")
    rows = [
        json.loads(to_json(full_row(number, "ego"))) | {"failure": failure}
        for number, failure in enumerate(failures)
    ]
    (folder.path / "rows.jsonl").write_text("".join(f"{json.dumps(row)}\n" for row in rows))
    task = {
        "recording": "drive",
        "method": "ego",
        "num_examples": 3,
        "counts": {"sweeps_read": 6, "sweeps read": 3, "holes, across which no triplet reaches": 2},
        "damages": ["drive.mcap, byte 7: cut"],
    }
    (folder.path / "tasks.jsonl").write_text(f"{json.dumps(task)}\n")


def test_run_of_an_early_version_can_be_read(tmp_path, recording):
    folder = start(tmp_path / "out", recording)
    old_run(folder)
    run = folder.read_record()
    assert not run.is_of_this_version
    assert [(one.name, one.traits.is_reference) for one in run.methods] == [("ego", True)]
    assert run.options == replace(small.options(), settings=run.options.settings)
    before = small.options().settings.to_mapping()
    differing = {k for k, v in run.options.settings.to_mapping().items() if before[k] != v}
    assert differing == set()
    assert run.recordings[0].fingerprint is None
    good, failed, dropped = folder.rows
    assert good.failure is None
    assert failed.failure == Failure(FailureKind.FAILED, "no points")
    assert dropped.failure == DROPPED
    results = read_results(folder)
    assert results.is_incomplete
    assert [(note.kind, note.text) for note in results.notes if note.kind.is_incomplete] == [
        (NoteKind.DAMAGE, "Damage: drive.mcap, byte 7: cut")
    ]
    assert [note.text for note in results.notes if note.kind is NoteKind.EVENT] == [
        "drive: holes, across which no triplet reaches: 2."
    ]
    (summary,) = results.summaries
    assert (summary.num_examples, summary.num_failed, summary.num_dropped) == (1, 1, 1)


def test_run_of_an_early_version_cannot_be_resumed(tmp_path, recording):
    folder = start(tmp_path / "out", recording)
    old_run(folder)
    before = {file: file.read_bytes() for file in folder.path.iterdir()}
    with pytest.raises(EvaluationError, match="another version") as caught:
        start(tmp_path / "out", recording, resume=True)
    assert "\n" not in str(caught.value)
    assert {file: file.read_bytes() for file in folder.path.iterdir()} == before


def test_damage_that_a_later_session_finds_is_recorded(tmp_path, recording):
    def damaged(text):
        return replace(recording, damages=[f"drive.mcap, byte 7: {text}"])

    start(tmp_path / "out", damaged("old"))
    start(tmp_path / "out", damaged("new"), resume=True)
    (known,) = RunFolder(tmp_path / "out").read_record().recordings
    assert known.damages == ["drive.mcap, byte 7: old", "drive.mcap, byte 7: new"]


def test_folder_without_a_run_holds_nothing_from_before(tmp_path):
    for path in (tmp_path / "nowhere", tmp_path):
        with RunFolder(path).opened(resume=True) as folder:
            assert folder.before is None
    (tmp_path / "text.txt").touch()
    with (
        pytest.raises(EvaluationError, match="holds no run"),
        RunFolder(tmp_path).opened(resume=True),
    ):
        pass
    assert [file.name for file in tmp_path.iterdir()] == ["text.txt"]


def test_path_that_is_no_text_comes_back(tmp_path, recording):
    path = os.fsdecode(b"bad\xff")
    folder = start(tmp_path / "out", replace(recording, path=path))
    assert folder.read_record().recordings[0].path == path
    (folder.path / "run.json").read_text(encoding="utf-8")
    assert path_text(path) == r"bad\xff"
    assert path_text("\udcc3\udc9cber «x»") == "Über «x»"


def test_file_that_cannot_be_written_is_named_and_the_old_one_stays(tmp_path):
    file = tmp_path / "file"
    replace_file(file, ["old"])
    (tmp_path / ".file.new").mkdir()
    with pytest.raises(WritingError, match="file: cannot be written: Is a directory"):
        replace_file(file, ["new"])
    assert file.read_text() == "old"
