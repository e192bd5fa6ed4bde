# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.errors import EvaluationError, RecordingError, SettingsError
from mnsf_ros.evaluation import task as task_module
from mnsf_ros.evaluation.executors import run_serially
from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import choose_topics, recording_names
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.task import TaskFailed, TaskRestarted, run_task
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.settings import Settings
from msg_utils.point_cloud2 import encode_columns

WARM = {"warm_start.enabled": True, "warm_start.max_iterations": 2}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 7)


def rows_of(task, options, skipped=frozenset()):
    *rows, findings = run_task(replace(task, skipped=skipped), options)
    assert isinstance(findings, Findings)
    return rows


def evaluate(out, bag, methods, options=None, *, resume=False, execute=run_serially, watch=None):
    """Runs what is left to do; returns the tasks that gave up, the events, and the folder."""
    options = options or small.options()
    recordings, methods = [small.recording_at(bag)], small.methods_of(methods, options)
    return small.run(out, recordings, methods, options, resume=resume, execute=execute, watch=watch)


def num_rows(events):
    return sum(isinstance(event, ResultRow) for event in events)


def test_odometry_is_right_about_all_that_stands_still(bag):
    rows = rows_of(small.task_at(bag, "ego"), small.options())
    assert [row.number for row in rows] == [1, 2, 3, 4, 5]
    for row in rows:
        assert row.failure is None
        assert row.errors["static"].epe_m == pytest.approx(0, abs=1e-6)
        # Movers go 0.1 m to the left.
        assert row.errors["dynamic"].epe_m == pytest.approx(0.1, rel=1e-5)
        assert row.bucketed["CAR"]["dynamic"] == pytest.approx(1.0, rel=1e-5)
        assert list(row.by_speed) == ["0.5", "2"]
        assert row.time_ms >= 0


def test_ground_of_the_truth_is_left_out(bag):
    (row, *_) = rows_of(small.task_at(bag, "zero"), small.options())
    assert row.num_points == 54
    kept = small.options({"ground.remove": False})
    (row, *_) = rows_of(small.task_at(bag, "zero"), kept)
    assert row.num_points == 60


@pytest.mark.parametrize("method", ["fnsf", "mnsf"])
def test_same_task_gives_the_same_rows(bag, method):
    options = small.options(num_points=30)
    first, second = (rows_of(small.task_at(bag, method), options) for _ in range(2))
    assert list(map(small.without_times, first)) == list(map(small.without_times, second))
    other = rows_of(small.task_at(bag, method), small.options(num_points=30, seed=1))
    assert small.without_times(first[0]) != small.without_times(other[0])
    assert first[0].stop_reasons
    assert first[0].iterations["forward"] == 3


def test_skipped_sweeps_do_not_change_the_others(bag):
    task, options = small.task_at(bag, "fnsf"), small.options()
    whole = rows_of(task, options)
    part = rows_of(task, options, skipped=frozenset([1, 3]))
    assert [row.number for row in part] == [2, 4, 5]
    assert [small.without_times(row) for row in part] == [
        small.without_times(row) for row in whole if row.number in (2, 4, 5)
    ]


def test_recording_without_truth_gives_consistency_and_time(tmp_path):
    path = small.write_recording(tmp_path / "plain", with_truth=False, with_odometry=False)
    rows = rows_of(small.task_at(path, "zero"), small.options())
    assert len(rows) == 4
    for row in rows:
        assert row.errors == {}
        assert row.consistency["nearest_m"] == row.consistency["zero_nearest_m"] > 0
    (row, *_) = rows_of(small.task_at(path, "ego"), small.options())
    assert "does the recording have odometry" in str(row.failure)


def test_method_that_fails_on_an_example_goes_on_with_the_next(bag):
    # Nothing is left of any sweep.
    far = small.options({"crop.min_range_m": 70.0, "crop.max_range_m": 71.0})
    rows = rows_of(small.task_at(bag, "mnsf"), far)
    assert len(rows) == 5
    assert all("points are left" in str(row.failure) for row in rows)


def test_cycle_is_checked_when_asked(bag):
    (row, *_) = rows_of(small.task_at(bag, "ego"), small.options(check_cycle=True))
    assert row.consistency["cycle_m"] == pytest.approx(0, abs=1e-6)
    (row, *_) = rows_of(small.task_at(bag, "ego"), small.options())
    assert "cycle_m" not in row.consistency


def test_real_time_drops_what_comes_too_fast(bag):
    # A thousand times faster than the recording: no estimate takes less than 0.1 ms.
    rows = rows_of(small.task_at(bag, "mnsf"), small.options(realtime_rate=1e6))
    assert sorted(row.number for row in rows) == [1, 2, 3, 4, 5]
    dropped = [row for row in rows if row.is_dropped]
    assert [row.number for row in dropped] == [2, 3, 4]
    assert all(row.latency_ms >= row.time_ms for row in rows if not row.failure)
    # The points that count are those of a run without real time.
    assert {row.num_points for row in rows} == {54}


def test_real_time_keeps_all_that_comes_slowly(bag):
    rows = rows_of(small.task_at(bag, "zero"), small.options(realtime_rate=0.001))
    assert [row.failure for row in rows] == [None] * 5
    assert {row.errors["all"].num_points for row in rows} == {54}


def test_predictions_of_another_program_are_scored(bag, tmp_path):
    for index in range(7):
        np.savez(tmp_path / f"{small.stamp(index)}.npz", flow=small.truth(index).flow)
    rows = rows_of(small.task_at(bag, f"file:{tmp_path}"), small.options(num_points=20))
    assert [row.errors["all"].epe_m for row in rows] == [0.0] * 5
    assert all(np.isnan(row.time_ms) for row in rows)
    (tmp_path / f"{small.stamp(2)}.npz").unlink()
    rows = rows_of(small.task_at(bag, f"file:{tmp_path}"), small.options(num_points=20))
    assert [bool(row.failure) for row in rows] == [False, True, False, False, False]


def test_run_writes_rows_and_tasks(bag, tmp_path):
    failed, events, folder = evaluate(tmp_path / "out", bag, ["zero", "ego"])
    assert num_rows(events) == 10
    assert not failed
    rows = list(folder.rows)
    assert [(row.method, row.number) for row in rows] == [
        (method, number) for method in ("zero", "ego") for number in range(1, 6)
    ]
    assert set(folder.finished()) == {("drive", "zero"), ("drive", "ego")}


def test_resume_of_a_finished_run_does_nothing(bag, tmp_path):
    evaluate(tmp_path / "out", bag, ["ego"])
    before = (tmp_path / "out" / "rows.jsonl").read_bytes()
    _, events, _ = evaluate(tmp_path / "out", bag, ["ego"], resume=True)
    assert events == []
    assert (tmp_path / "out" / "rows.jsonl").read_bytes() == before


class Stop(KeyboardInterrupt):
    """Ctrl-C in the middle of a run."""


def interrupted_after(num_rows):
    seen = []

    def watch(task, event):
        seen.append(event)
        if len(seen) == num_rows:
            raise Stop

    return watch


@pytest.fixture(scope="module", params=[{}, WARM], ids=["cold", "warm"])
def whole(request, bag, tmp_path_factory):
    """Changed settings, and the folder of a run with them that was not interrupted."""
    out, options = tmp_path_factory.mktemp("runs") / "whole", small.options(request.param)
    return request.param, evaluate(out, bag, ["mnsf", "fnsf"], options)[-1]


@pytest.mark.parametrize("number", [1, 3, 5, 6, 8])
def test_interrupted_and_resumed_run_is_like_one_that_was_not(bag, tmp_path, whole, number):
    changes, expected = whole
    options, methods = small.options(changes), ["mnsf", "fnsf"]
    with pytest.raises(Stop):
        evaluate(tmp_path / "out", bag, methods, options, watch=interrupted_after(number))
    kept = {(r.method, r.number): r.time_ms for r in list(RunFolder(tmp_path / "out").rows)}
    assert len(kept) == number - (number > 5)
    *_, resumed = evaluate(tmp_path / "out", bag, methods, options, resume=True)
    assert by_key(resumed) == by_key(expected)
    assert len(list(resumed.rows)) == 10
    if not changes:
        # What was there was not computed again.
        times = {(row.method, row.number): row.time_ms for row in resumed.rows}
        assert kept.items() <= times.items()


@pytest.mark.parametrize("method", ["online", "ego-estimated"])
def test_method_that_always_remembers_begins_anew(bag, tmp_path, method):
    options = small.options()
    with pytest.raises(Stop):
        evaluate(tmp_path / "out", bag, [method, "fnsf"], options, watch=interrupted_after(8))
    (tmp_path / "out" / "tasks.jsonl").write_text("")
    methods = small.methods_of([method, "fnsf"])
    record = RunRecord(options, methods, [small.recording_at(bag)], [small.SESSION])
    with RunFolder(tmp_path / "out").opened(resume=True) as folder:
        runs = folder.begin(record)
    assert [len(run.skipped) for run in runs] == [0, 2]
    assert [run.again(frozenset({1}), options).skipped != frozenset() for run in runs] == [
        False,
        True,
    ]
    assert {row.method for row in folder.rows} == {"fnsf"}


def by_key(folder):
    return {
        (row.recording, row.method, row.number): small.without_times(row) for row in folder.rows
    }


def test_method_added_to_a_run_is_all_that_is_computed(bag, tmp_path):
    evaluate(tmp_path / "out", bag, ["zero"])
    _, events, folder = evaluate(tmp_path / "out", bag, ["zero", "ego"], resume=True)
    assert num_rows(events) == 5
    assert len(list(folder.rows)) == 10


def scripted(events):
    """An executor that gives the events of a script, whatever it is asked for."""

    def execute(tasks, options):
        for event in events:
            yield tasks[0], event

    return execute


def row(number, method="ego"):
    return ResultRow("drive", number, number, method, 10)


def test_rows_that_come_twice_after_a_restart_are_written_once(bag, tmp_path):
    events = [row(1), row(2), TaskRestarted("lost"), row(2), row(3), Findings()]
    *_, folder = evaluate(tmp_path / "out", bag, ["ego"], execute=scripted(events))
    assert [item.number for item in folder.rows] == [1, 2, 3]


def test_rows_before_a_restart_are_dropped_where_examples_depend_on_each_other(bag, tmp_path):
    method = "mnsf"
    events = [row(1, method), row(2, method), TaskRestarted("lost"), row(1, method)]
    execute = scripted([*events, TaskFailed("lost again")])
    options = small.options(WARM)
    failed, _, folder = evaluate(tmp_path / "out", bag, [method], options, execute=execute)
    assert [item.number for item in folder.rows] == [1]
    assert failed == {("drive", method): "lost again"}
    assert folder.finished() == {}


def test_unknown_method_gives_up_its_task_only(bag, tmp_path):
    failed, _, folder = evaluate(tmp_path / "out", bag, ["mnfs", "ego"])
    assert "unknown method 'mnfs'" in failed["drive", "mnfs"]
    assert len(list(folder.rows)) == 5


def test_sweeps_are_the_usual_ones_where_there_is_truth(bag):
    inspection = inspect_recording(bag)
    recording = choose_topics(inspection, "drive")
    assert (recording.points, recording.truth, recording.odometry) == (
        "/points",
        "/truth/flow",
        "/truth/odometry",
    )
    assert recording.num_sweeps == 7
    with pytest.raises(RecordingError, match="no topic '/lidar'"):
        choose_topics(inspection, "drive", points="/lidar")
    with pytest.raises(RecordingError, match="is of type nav_msgs"):
        choose_topics(inspection, "drive", truth="/truth/odometry")
    with pytest.raises(RecordingError, match="cannot be both"):
        choose_topics(inspection, "drive", points="/truth/flow")


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"num_points": 0}, "num_points: got 0"),
        ({"seed": -1}, "seed: got -1"),
        ({"realtime_rate": 0.0}, "realtime rate: got 0.0"),
        ({"realtime_rate": float("nan")}, "realtime rate: got nan"),
        ({"every": 0}, "every: got 0"),
        ({"every": 2, "realtime_rate": 1.0}, "--every cannot be combined"),
    ],
)
def test_options_out_of_range_are_refused(values, text):
    with pytest.raises(EvaluationError, match=text):
        EvaluationOptions(Settings(), **values)


def test_methods_get_the_settings_of_the_run_and_a_fixed_number_of_threads():
    settings = EvaluationOptions(preset("paper"), seed=5).settings
    assert settings.ground.remove
    assert settings.compute.num_threads == 1
    assert settings.compute.seed == 5
    live = EvaluationOptions(preset("online"), realtime_rate=1.0).settings
    assert live.ground.remove
    chosen = preset("paper").changed({"compute.num_threads": 3})
    assert EvaluationOptions(chosen).settings.compute.num_threads == 3


def test_recordings_are_named_by_their_last_part_if_that_is_enough(tmp_path):
    for name in ("a/drive", "b/drive", "b/street"):
        (tmp_path / name).mkdir(parents=True)
    (tmp_path / "log.mcap").touch()
    paths = [tmp_path / name for name in ("a/drive", "b/street", "log.mcap")]
    assert recording_names(paths) == ["drive", "street", "log"]
    paths = [tmp_path / "a" / "drive", tmp_path / "b" / "drive"]
    assert recording_names(paths) == [str(path) for path in paths]
    with pytest.raises(EvaluationError, match="is named 2 times"):
        recording_names([paths[0], paths[0]])


def test_unstamped_sweeps_take_the_time_of_reception(tmp_path):
    from rosbags.typesys import Stores, get_typestore

    from mnsf_ros.recording.bag_messages import cloud_message
    from mnsf_ros.recording.bag_writer import BagWriter
    from msg_utils.point_cloud2 import encode_columns

    store = get_typestore(Stores.ROS2_JAZZY)
    kind = "sensor_msgs/msg/PointCloud2"
    with BagWriter(tmp_path / "bag") as writer:
        for index in range(3):
            points = small.xyz(index)
            columns = {name: points[:, axis] for axis, name in enumerate("xyz")}
            message = cloud_message(encode_columns(columns, 1, 60), 0, "lidar", is_dense=True)
            raw = store.serialize_cdr(message, kind)
            writer.write_raw("/points", kind, small.stamp(index), raw)
    *rows, findings = run_task(small.task_at(tmp_path / "bag", "zero"), small.options())
    assert [row.stamp_ns for row in rows] == [small.stamp(1)]
    assert findings.warnings == {Event.SWEEPS_UNSTAMPED: 3}


def test_settings_error_before_anything_is_written(bag):
    with pytest.raises(SettingsError, match="unknown method"):
        list(run_task(small.task_at(bag, "nothing"), small.options()))


def test_rows_of_the_online_method_say_whether_it_knew_the_sweeps_before(bag):
    options = small.options({"warm_start.enabled": True})
    starts = [row.start for row in rows_of(small.task_at(bag, "online"), options)]
    assert starts[0] == "cold: first triplet"
    assert set(starts[1:]) == {"warm"}


@pytest.mark.parametrize(("method", "num_estimates"), [("zero", 3), ("ego-estimated", 8)])
def test_every_third_example_is_scored(tmp_path, monkeypatch, method, num_estimates):
    """A method that registers sweep after sweep sees those between, too."""
    path = small.write_recording(tmp_path / "drive", 10)
    calls = []

    def counted(name, settings):
        estimator = make_method(name, settings)
        estimate = estimator.estimate

        def counting(triplet):
            calls.append(triplet.current.stamp_ns)
            return estimate(triplet)

        estimator.estimate = counting
        return estimator

    monkeypatch.setattr(task_module, "make_method", counted)
    monkeypatch.setattr(task_module, "warm_up", lambda method, settings: None)
    task = small.task_at(path, method)
    rows = [row for row in run_task(task, small.options(every=3)) if isinstance(row, ResultRow)]
    assert [row.number for row in rows] == [1, 4, 7]
    assert len(calls) == num_estimates


def test_sampling_counts_examples_wherever_they_are(tmp_path):
    """After a gap the numbers of sweeps go on, but the examples between are not there."""
    with BagWriter(tmp_path / "drive") as writer:
        for index in (0, 1, 20, 21, 22, 23, 24, 25):
            points = small.xyz(index)
            columns = {name: points[:, axis] for axis, name in enumerate("xyz")}
            encoded = encode_columns(columns, 1, len(points))
            writer.write_cloud("/points", encoded, small.stamp(index), "lidar")
    task = small.task_at(tmp_path / "drive", "zero")
    found = [[row.number for row in rows_of(task, small.options(every=n))] for n in (1, 2, 3, 20)]
    assert found == [[3, 4, 5, 6], [3, 5], [3, 6], [3]]
    rest = rows_of(task, small.options(every=2), frozenset({3}))
    assert [row.number for row in rest] == [5]


@pytest.mark.parametrize("method", ["ego-estimated", "online", "fnsf"])
def test_way_back_is_measured_for_methods_that_know_time(tmp_path, method):
    path = small.write_recording(tmp_path / "drive", 5, num_points=400)
    options = small.options({"ego_motion.removed": True, "ground.remove": False}, check_cycle=True)
    rows = rows_of(small.task_at(path, method), options)
    assert [row.failure for row in rows] == [None] * 3
    assert all(row.consistency["cycle_m"] >= 0 for row in rows)


def test_sampled_rows_are_those_of_the_whole_run(bag):
    task = small.task_at(bag, "fnsf")
    whole, sampled = (
        [small.without_times(row) for row in rows_of(task, small.options(every=every))]
        for every in (1, 2)
    )
    assert [row["number"] for row in sampled] == [1, 3, 5]
    assert sampled == whole[::2]
