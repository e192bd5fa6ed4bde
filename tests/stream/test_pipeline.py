# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import time

import numpy as np
import pytest
from pipelines import PATIENCE_S, assert_balanced, counts_of

from mnsf_ros.errors import SweepError
from mnsf_ros.sweeps.sweep_buffer import Arrival


@pytest.fixture
def pipeline(make_pipeline, quick_settings):
    return make_pipeline(quick_settings)


@pytest.fixture
def add(pipeline, wait_until):
    """Adds sweeps and waits until nothing is left to do."""

    def add_sweeps(*sweeps, **options):
        for sweep in sweeps:
            pipeline.add_sweep(sweep, time.monotonic_ns(), **options)
        wait_until(lambda: pipeline.load == 0)

    return add_sweeps


@pytest.fixture
def hold_first_flow(recorder, make_sweep):
    """Adds three sweeps and waits until their flow is held up before it is handed out."""

    def hold(pipeline):
        recorder.gate.hold()
        for index in range(3):
            pipeline.add_sweep(make_sweep(index), time.monotonic_ns())
        assert recorder.gate.is_reached.wait(PATIENCE_S)

    return hold


def test_flow_of_the_middle_sweep(pipeline, add, recorder, make_sweep, motion):
    sweeps = [make_sweep(index) for index in range(3)]
    arrived_ns = time.monotonic_ns()
    add(*sweeps)
    ((job, estimate),) = recorder.handed_out
    assert [job.triplet.previous, job.triplet.current, job.triplet.next] == sweeps
    assert estimate.flow.shape == sweeps[1].xyz.shape
    errors_m = np.linalg.norm(estimate.flow - motion, axis=1)
    assert np.median(errors_m) < 0.1
    snapshot = pipeline.statistics.snapshot()
    assert snapshot.counts == {"sweeps_received": 3, "triplets_formed": 1, "flows_out": 1}
    assert 0 < snapshot.latency_ms(50) < (time.monotonic_ns() - arrived_ns) / 1e6


def test_sweeps_that_nobody_watches_are_only_kept(pipeline, add, recorder, make_sweep):
    add(*(make_sweep(index) for index in range(4)), is_watched=False)
    assert recorder.handed_out == []
    assert counts_of(pipeline)["triplets_unwatched"] == 2
    add(make_sweep(4))
    assert recorder.current_stamps == [make_sweep(3).stamp_ns]
    assert_balanced(pipeline)


def test_a_triplet_waiting_while_the_watcher_leaves_is_still_handed_out(
    pipeline, recorder, make_sweep, wait_until, hold_first_flow
):
    hold_first_flow(pipeline)
    pipeline.add_sweep(make_sweep(3), time.monotonic_ns())
    pipeline.add_sweep(make_sweep(4), time.monotonic_ns(), is_watched=False)
    recorder.gate.let_go()
    wait_until(lambda: pipeline.load == 0)
    assert recorder.current_stamps == [make_sweep(1).stamp_ns, make_sweep(2).stamp_ns]
    assert_balanced(pipeline)


class TestFailure:
    def test_of_a_triplet_is_counted_and_the_next_one_is_fine(
        self, pipeline, add, recorder, make_sweep
    ):
        bad = make_sweep(2, num_points=8)
        for sweep in (make_sweep(0), make_sweep(1), bad, make_sweep(3), make_sweep(4)):
            add(sweep)
        assert recorder.handed_out == []
        failed = [job.triplet for job, _ in recorder.failures]
        assert [bad in (item.previous, item.current, item.next) for item in failed] == 3 * [True]
        assert all(isinstance(error, SweepError) for _, error in recorder.failures)
        snapshot = pipeline.statistics.snapshot()
        assert snapshot.failures_in_a_row == snapshot.counts["estimates_failed"] == 3
        assert snapshot.last_failure.startswith(f"{bad}: 6 of 6 points are left")

        add(make_sweep(5))
        assert recorder.current_stamps == [make_sweep(4).stamp_ns]
        assert pipeline.statistics.snapshot().failures_in_a_row == 0
        assert_balanced(pipeline)


def test_sweeps_that_do_not_continue_are_counted_by_kind(pipeline, add, make_sweep):
    add(*(make_sweep(index) for index in range(3)))
    kinds = [pipeline.add_sweep(make_sweep(index), time.monotonic_ns()) for index in (2, 9)]
    assert kinds == [Arrival.DUPLICATE, Arrival.GAP]
    counts = counts_of(pipeline)
    assert (counts["sweeps_duplicate"], counts["sweeps_gap"]) == (1, 1)
    assert counts["triplets_formed"] == 1


class TestClose:
    def test_while_a_flow_is_handed_out_lets_it_be_the_last(
        self, pipeline, recorder, make_sweep, wait_until, hold_first_flow
    ):
        hold_first_flow(pipeline)
        pipeline.add_sweep(make_sweep(3), time.monotonic_ns())
        assert pipeline.close(0.0) is False
        recorder.gate.let_go()
        assert pipeline.close(PATIENCE_S) is True
        assert recorder.current_stamps == [make_sweep(1).stamp_ns]

    def test_while_it_fails_reports_no_failure(self, pipeline, recorder, hold_first_flow):
        recorder.error = RuntimeError("the publisher is gone")
        hold_first_flow(pipeline)
        assert pipeline.close(0.0) is False
        recorder.gate.let_go()
        assert pipeline.close(PATIENCE_S) is True
        assert recorder.failures == []


def test_every_triplet_of_a_rough_ride_ends_in_exactly_one_way(pipeline, make_sweep, wait_until):
    random = np.random.default_rng(1)
    index = 0.0
    for _ in range(300):
        index += random.choice([1.0, 0.0, -0.5, 8.0, -100.0], p=[0.8, 0.05, 0.05, 0.05, 0.05])
        sweep = make_sweep(index, num_points=int(random.choice([400, 8], p=[0.95, 0.05])))
        pipeline.add_sweep(sweep, time.monotonic_ns(), is_watched=bool(random.random() < 0.9))
        if random.random() < 0.3:
            wait_until(lambda: pipeline.load == 0)
    wait_until(lambda: pipeline.load == 0)
    assert_balanced(pipeline)
    counts = counts_of(pipeline)
    assert counts["sweeps_received"] == 300
    assert counts["flows_out"] > 0
    assert counts["estimates_failed"] > 0
    assert counts["triplets_unwatched"] > 0


def test_errors_of_both_callbacks_do_not_end_the_stream(
    pipeline, add, recorder, make_sweep, caplog
):
    recorder.error, recorder.failure_error = RuntimeError("cannot publish"), OSError("cannot log")
    for index in range(4):
        add(make_sweep(index))
    assert len(recorder.failures) == counts_of(pipeline)["estimates_failed"] == 2
    assert pipeline.statistics.snapshot().last_failure == "RuntimeError: cannot publish"
    assert "cannot log" in caplog.text
    recorder.error = recorder.failure_error = None
    add(make_sweep(4))
    assert recorder.current_stamps == [make_sweep(3).stamp_ns]
    assert_balanced(pipeline)
