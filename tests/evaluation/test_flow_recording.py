# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of a run as recordings: `--write-flow`."""

from __future__ import annotations

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.executors import run_serially
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import flow_path, flow_recorder
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.recording.bag_reader import BagReader


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 5)


def evaluate(out, bag, options, *, resume=False, execute=run_serially):
    recordings, methods = [small.recording_at(bag)], small.methods_of(["zero", "ego"])
    return small.run(out, recordings, methods, options, resume=resume, execute=execute)[1:]


def with_flow(out):
    return small.options(flow_folder=out / "flow")


def column(message, name):
    """One field of a cloud, which all are four bytes apart but flags."""
    (field,) = [field for field in message.fields if field.name == name]
    rows = message.data.reshape(-1, message.point_step)
    return np.ascontiguousarray(rows[:, field.offset : field.offset + 4]).view(np.float32)[:, 0]


def test_estimate_error_and_truth_are_written(bag, tmp_path):
    *rows, _ = run_task(small.task_at(bag, "ego"), small.options(flow_folder=tmp_path))
    with BagReader(tmp_path / "drive.ego") as reader:
        counts = {topic: summary.count for topic, summary in reader.topics.items()}
        assert counts == {"/flow": 3, "/flow/error": 3, "/flow/truth": 3}
        scans = [list(reader.messages(topic)) for topic in counts]
    for row, flow, error, truth in zip(rows, *scans, strict=True):
        assert flow.header.frame_id == "lidar"
        axes = ("flow_x", "flow_y", "flow_z")
        difference = [column(flow, axis) - column(truth, axis) for axis in axes]
        distance = np.linalg.norm(difference, axis=0)
        assert column(error, "error_m") == pytest.approx(distance, abs=1e-6)
        assert distance.mean() == pytest.approx(row.errors["all"].epe_m, abs=1e-6)


def test_what_is_there_already_is_replaced_only_if_it_is_a_recording(tmp_path):
    path = flow_path(tmp_path, "drive", "ego")
    path.mkdir()
    (path / "notes.txt").write_text("mine")
    with (
        pytest.raises(RecordingError, match="is not replaced"),
        flow_recorder(tmp_path, "drive", "ego"),
    ):
        pass
    assert (path / "notes.txt").read_text() == "mine"


def test_what_a_killed_process_left_behind_is_taken_away(bag, tmp_path):
    left, other = tmp_path / ".drive.ego.x7.partial", tmp_path / ".drive.mnsf.x7.partial"
    for folder in (left, other):
        folder.mkdir()
        (folder / "ego.mcap").write_bytes(b"half")
    list(run_task(small.task_at(bag, "ego"), small.options(flow_folder=tmp_path)))
    assert not left.exists()
    assert other.exists()


def test_run_that_was_killed_before_it_could_say_that_a_task_was_done_can_go_on(bag, tmp_path):
    def killed_before_the_last_word(runs, options):
        for task, event in run_serially(runs, options):
            if isinstance(event, Findings):
                raise KeyboardInterrupt
            yield task, event

    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        evaluate(out, bag, with_flow(out), execute=killed_before_the_last_word)
    assert flow_path(out / "flow", "drive", "zero").exists()
    events, folder = evaluate(out, bag, with_flow(out), resume=True)
    assert isinstance(events[-1], Findings)
    assert len(list(folder.rows)) == 6
    assert len(list((out / "flow").iterdir())) == 2


def test_flow_that_is_asked_for_later_is_made_then(bag, tmp_path):
    out = tmp_path / "out"
    evaluate(out, bag, small.options())
    events, folder = evaluate(out, bag, with_flow(out), resume=True)
    assert sum(isinstance(event, ResultRow) for event in events) == 6
    assert len(list(folder.rows)) == 6
    assert len(list((out / "flow").iterdir())) == 2
    events, _ = evaluate(out, bag, with_flow(out), resume=True)
    assert events == []
