# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The files of a run, and which of its tasks are left when it is resumed."""

import json
import math
import os
import re
from dataclasses import replace

import pytest
import small_evaluations as small

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.recordings import named_recordings
from mnsf_ros.evaluation.run_folder import RunFolder, StoppedError, from_json, replace_file, to_json
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.task import FinishedTask

NAN = math.nan
ERRORS = FlowErrors(0.1, 0.2, 0.3, 0.4, 0.5, 6)


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
        errors={"all": ERRORS, "dynamic": FlowErrors(NAN, NAN, NAN, NAN, NAN, 0)},
        by_range={"10": ERRORS},
        sums={"CAR/0": [3.0, 0.3, 0.0]},
        start="warm",
        failure="no points: «ä»",
    )


def test_row_comes_back_to_the_last_digit_from_json_for_every_program():
    row = full_row()
    line = to_json(row)
    assert "\n" not in line
    again = from_json(line, ResultRow, "line 1")
    # NaN is not equal to itself, so texts are compared.
    assert to_json(again) == line
    assert (again.time_ms, again.failure) == (row.time_ms, row.failure)
    assert math.isnan(again.latency_ms)
    values = json.loads(line, parse_constant=pytest.fail)
    assert values["latency_ms"] is values["errors"]["dynamic"]["epe_m"] is None


@pytest.fixture
def recording(tmp_path):
    return small.recording_at(small.write_recording(tmp_path / "bags" / "drive", 3))


def begin(out, recording, options=None, *, resume=False, methods=("ego",)):
    """Begins a run and ends it before anything is done; returns the folder and what is left."""
    record = RunRecord(
        options or small.options(), small.methods_of(methods), [recording], [small.SESSION]
    )
    folder = RunFolder(out)
    return folder, folder.begin(record, resume=resume)


def test_run_json_tells_what_is_run(tmp_path, recording):
    options = small.options(num_points=10, seed=4)
    # Whatever the path is, the file is UTF-8.
    recording = replace(recording, path=os.fsdecode(b"bad\xff"))
    folder, _ = begin(tmp_path / "new" / "out", recording, options)
    (folder.path / "run.json").read_text(encoding="utf-8")
    run, _ = folder.read()
    assert run.options == options
    assert run.options.settings.compute.seed == 4
    assert (run.method_names, run.references) == (["ego"], {"ego"})
    assert run.recordings == [recording]
    (session,) = run.sessions
    assert session["command"] == "mnsf"
    assert {"torch", "numpy", "mnsf_ros", "python"} <= session.keys()
    assert "cores" in session["machine"]


def test_empty_folder_and_resume_of_nothing_just_start(tmp_path, recording):
    (tmp_path / "out").mkdir()
    # What is left of a run that was killed while its first file was written.
    (tmp_path / "out" / ".run.json.1f.new").write_text("{")
    begin(tmp_path / "out", recording)
    begin(tmp_path / "other", recording, resume=True)
    for name in ("out", "other"):
        assert [path.name for path in (tmp_path / name).glob("[!.]*")] == ["run.json"]


@pytest.mark.parametrize(
    ("options", "text"),
    [
        (small.options(num_points=9), "num_points was 0, is 9"),
        (small.options({"crop.max_range_m": 30.0}), "crop.max_range_m was 80.0, is 30.0"),
        (small.options(realtime=1.0), "realtime was 0.0, is 1.0"),
        (small.EvaluationOptions(small.preset("online")), "; and "),
    ],
)
def test_runs_with_other_settings_are_not_mixed(tmp_path, recording, options, text):
    begin(tmp_path / "out", recording)
    with pytest.raises(EvaluationError, match="holds a run with other settings") as caught:
        begin(tmp_path / "out", recording, options, resume=True)
    assert text in str(caught.value)
    assert str(caught.value).count(" was ") <= 5


def test_other_topics_are_refused_and_a_recording_that_moved_is_not(tmp_path):
    bag = small.write_recording(tmp_path / "a" / "drive", 3)
    out, recording = tmp_path / "out", small.recording_at(bag)
    begin(out, recording)
    text = "another recording 'drive': .*truth was /truth/flow, is None"
    with pytest.raises(EvaluationError, match=text):
        begin(out, replace(recording, truth=None), resume=True)
    moved = bag.rename(tmp_path / "drive")
    folder, _ = begin(out, small.recording_at(moved), resume=True)
    (known,) = folder.read()[0].recordings
    assert known.path == str(moved)


def test_recordings_are_named_by_the_last_part_of_their_path_if_that_is_enough(
    tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    paths = [tmp_path / name for name in ("a/drive", "b/street", os.fsdecode(b"bad\xff"))]
    for path in paths:
        path.mkdir(parents=True)
    (tmp_path / "log.mcap").touch()
    paths.append(tmp_path / "log.mcap")
    names = ["drive", "street", r"bad\xff", "log"]
    assert named_recordings(paths) == list(zip(names, paths, strict=True))
    other = tmp_path / "b" / "drive"
    other.mkdir()
    assert [name for name, _ in named_recordings([paths[0], other])] == [str(paths[0]), str(other)]
    (tmp_path / "link").symlink_to(other)
    for same in (other, other.relative_to(tmp_path), tmp_path / "link"):
        with pytest.raises(EvaluationError, match=r"is the same recording as .*; name it once"):
            named_recordings([other, same])


def done_run(out, recording, num_rows=2):
    """A run whose only task is finished, with these rows."""
    record = RunRecord(small.options(), small.methods_of(["ego"]), [recording], [small.SESSION])
    folder = RunFolder(out)
    folder.begin(record, resume=False)
    for number in range(num_rows):
        folder.take(full_row(number, "ego"))
        assert [row.number for row in folder.read()[1]] == list(range(number + 1))
    folder.take(FinishedTask("drive", "ego", num_rows, {Event.GAP.value: 6}))
    return folder


def test_task_is_finished_if_all_of_its_rows_are_there(tmp_path, recording):
    folder = done_run(tmp_path / "out", recording)
    (known,) = folder.read()[0].finished
    assert (known.num_examples, known.counts) == (2, {Event.GAP.value: 6})
    assert begin(folder.path, recording, resume=True)[1] == []
    rows = folder.path / "rows.jsonl"
    first, second = rows.read_text().splitlines(keepends=True)
    for text, skipped in ((first, {0}), (first + second[:-40], {0}), ("", set())):
        rows.write_text(text)
        assert folder.read()[0].finished == []
        (task,) = begin(folder.path, recording, resume=True)[1]
        assert task.skipped == skipped
        # A line that was being written when a process was killed is gone.
        assert rows.read_text() == text.partition("\n")[0] + "\n" * len(skipped)
    rows.unlink()
    assert len(begin(folder.path, recording, resume=True)[1]) == 1


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("rows.jsonl", "rubbish\n"),
        ("rows.jsonl", "\n"),
        ("rows.jsonl", '{"colour": 1}\n'),
        ("rows.jsonl", f'{{"recording": {"[" * 200_000}{"]" * 200_000}}}\n'),
        ("run.json", "{}"),
        ("run.json", None),
        ("rows.jsonl", None),
    ],
)
def test_damaged_file_is_named(tmp_path, recording, name, text):
    folder = done_run(tmp_path / "out", recording)
    file = folder.path / name
    file.unlink()
    if text is None:
        # Whoever opened it would wait.
        os.mkfifo(file)
    else:
        file.write_text(text)
    reason = ": is not a file" if text is None else "(, line 1)?: cannot be read"
    with pytest.raises(EvaluationError, match=rf"{re.escape(name)}{reason}") as caught:
        begin(folder.path, recording, resume=True)
    assert "\n" not in str(caught.value)


def test_file_that_cannot_be_written_stops_the_run(tmp_path):
    with pytest.raises(StoppedError, match="is a folder"):
        replace_file(tmp_path, "new")
