# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One method on one recording: rows, findings and kept flow of a task."""

from dataclasses import replace

import pytest
import small_evaluations as small
from bag_messages import cloud_cdr

from mnsf_ros.errors import SettingsError
from mnsf_ros.evaluation.findings import Event
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.task import FinishedTask, run_task
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.settings import Settings
from msg_utils.point_cloud2 import encode_columns


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 7)


def rows_of(task, options, skipped=frozenset()):
    *rows, findings = run_task(replace(task, skipped=skipped), options)
    assert isinstance(findings, FinishedTask)
    return rows


def test_odometry_is_right_about_static_points(bag):
    rows = rows_of(small.task_at(bag, "ego"), small.options())
    assert [row.number for row in rows] == [1, 2, 3, 4, 5]
    for row in rows:
        assert row.failure is None
        # Without the ground of the truth.
        assert row.num_points == 54
        assert row.errors["static"].epe_m == pytest.approx(0, abs=1e-6)
        # Movers go 0.1 m to the left.
        assert row.errors["dynamic"].epe_m == pytest.approx(0.1, rel=1e-5)
        assert list(row.by_speed) == ["0.5", "2"]
        assert row.time_ms >= 0
    (row, *_) = rows_of(small.task_at(bag, "ego"), small.options({"ground.remove": False}))
    assert row.num_points == 60


@pytest.mark.parametrize("method", ["fnsf", "mnsf"])
def test_rows_depend_on_the_seed_alone(bag, method):
    options, task = small.options(num_points=30), small.task_at(bag, method)
    first, part = (rows_of(task, options, frozenset(skipped)) for skipped in ((), (1, 3)))
    assert list(map(small.without_times, part)) == [
        small.without_times(row) for row in first if row.number in (2, 4, 5)
    ]
    other = rows_of(task, small.options(num_points=30, seed=1))
    assert small.without_times(first[0]) != small.without_times(other[0])
    assert first[0].stop_reasons
    assert first[0].iterations["forward"] == 3


def test_recording_without_truth_gives_consistency_and_time(tmp_path):
    path = small.write_recording(tmp_path / "plain", with_truth=False, with_odometry=False)
    rows = rows_of(small.task_at(path, "zero"), small.options())
    assert len(rows) == 4
    for row in rows:
        assert row.errors == {}
        assert row.consistency["nearest_m"] == row.consistency["zero_nearest_m"] > 0
    (row, *_) = rows_of(small.task_at(path, "ego"), small.options())
    assert "does the recording have odometry" in str(row.failure)


def test_real_time_drops_what_comes_too_fast(bag):
    # A million times faster than the recording: no estimate takes less than 0.1 µs.
    rows = rows_of(small.task_at(bag, "mnsf"), small.options(realtime=1e6))
    assert sorted(row.number for row in rows) == [1, 2, 3, 4, 5]
    assert [row.number for row in rows if row.is_dropped] == [2, 3, 4]
    assert all(row.latency_ms >= row.time_ms for row in rows if not row.failure)
    # The points that count are those of a run without real time.
    assert {row.num_points for row in rows} == {54}


def test_rows_of_the_online_method_say_whether_it_was_warm(bag):
    options = small.options({"warm_start.enabled": True})
    starts = [row.start for row in rows_of(small.task_at(bag, "online"), options)]
    assert starts[0] == "cold: first triplet"
    assert set(starts[1:]) == {"warm"}


@pytest.mark.parametrize(
    ("values", "text"),
    [
        ({"seed": -1}, "seed: got -1"),
        ({"pictures": -1}, "pictures: got -1"),
        ({"realtime": float("nan")}, "realtime: got nan"),
        ({"every": 0}, "every: got 0"),
        ({"every": 2, "realtime": 1.0}, "--every cannot be combined"),
    ],
)
def test_options_out_of_range_are_refused(values, text):
    with pytest.raises(SettingsError, match=text):
        EvaluationOptions(Settings(), **values)


def test_methods_get_the_seed_and_a_fixed_number_of_threads():
    settings = EvaluationOptions(preset("paper"), seed=5).settings
    assert (settings.compute.num_threads, settings.compute.seed) == (1, 5)
    chosen = preset("paper").changed({"compute.num_threads": 3})
    assert EvaluationOptions(chosen).settings.compute.num_threads == 3


def test_unstamped_sweeps_take_the_time_of_reception(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        for index in range(3):
            columns = dict(zip("xyz", small.xyz(index).T, strict=True))
            raw = cloud_cdr(encode_columns(columns, 1, 60), 0)
            writer.write_raw("/points", "sensor_msgs/msg/PointCloud2", small.stamp(index), raw)
    *rows, findings = run_task(small.task_at(tmp_path / "bag", "zero"), small.options())
    assert [row.stamp_ns for row in rows] == [small.stamp(1)]
    assert findings.counts == {Event.SWEEPS_UNSTAMPED: 3}


def test_sampling_counts_examples_wherever_they_are(tmp_path):
    """After a gap the numbers of sweeps go on, but the examples between are not there."""
    indices = (0, 1, 20, 21, 22, 23, 24, 25)
    task = small.task_at(
        small.write_recording(tmp_path / "drive", indices, with_truth=False), "zero"
    )
    found = [[row.number for row in rows_of(task, small.options(every=n))] for n in (1, 3, 20)]
    assert found == [[3, 4, 5, 6], [3, 6], [3]]
    assert [row.number for row in rows_of(task, small.options(every=2, max_examples=2))] == [3, 5]
    rest = rows_of(task, small.options(every=2), frozenset({3}))
    assert [row.number for row in rest] == [5]


@pytest.mark.parametrize("method", ["zero", "online"])
def test_sampling_changes_no_row_also_of_methods_that_carry_state(bag, method):
    whole, sampled = (rows_of(small.task_at(bag, method), small.options(every=n)) for n in (1, 3))
    assert list(map(small.without_times, sampled)) == list(map(small.without_times, whole[::3]))
