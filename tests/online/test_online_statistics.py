# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import dataclasses
import math
import threading

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import (
    FlowEstimate,
    OptimizationResult,
    OverGround,
    Start,
    StopReason,
)
from mnsf_ros.online.online_statistics import OnlineStatistics, StatisticsSnapshot, rate_hz


def make_estimate(start=Start.WARM):
    return FlowEstimate(
        flow=np.zeros((2, 3), np.float32),
        kept=np.ones(2, bool),
        times_ms={"prepare": 1.0, "forward": 2.0},
        fits={"forward": OptimizationResult(0.1, 7, StopReason.TIME_BUDGET)},
        start=start,
        device="cpu",
        distance_kind="tree",
        precision="bfloat16",
    )


class TestRate:
    def test_of_less_than_two_events_is_zero(self):
        assert rate_hz([], 10.0) == 0.0
        assert rate_hz([10.0], 10.0) == 0.0

    def test_counts_the_intervals_of_irregular_events(self):
        assert rate_hz([0.0, 0.1, 1.0, 2.0], 2.0) == pytest.approx(1.5)

    def test_falls_in_silence_toward_zero(self):
        times_s = [0.0, 0.5, 1.0]
        rates = [rate_hz(times_s, now_s) for now_s in (1.5, 2.0, 4.0, 100.0)]
        assert rates == sorted(rates, reverse=True)
        # 2 intervals in 1 s, and 3 - 0.5 s of silence too much.
        assert rates[2] == pytest.approx(2 / 3.5)
        assert rates[-1] < 0.03

    def test_of_events_at_the_same_time_is_finite(self):
        assert rate_hz([3.0, 3.0], 3.0) == 0.0


class TestSnapshot:
    def test_of_nothing(self):
        snapshot = OnlineStatistics().snapshot()
        assert snapshot == StatisticsSnapshot()
        assert math.isnan(snapshot.latency_ms(50))
        assert snapshot.flow_rate_hz(1.0) == snapshot.input_rate_hz(1.0) == 0.0

    def test_is_a_copy(self):
        statistics = OnlineStatistics()
        statistics.count("flows_out")
        before = statistics.snapshot()
        statistics.count("flows_out")
        statistics.add_arrival()
        statistics.add_estimate(5.0, make_estimate())
        statistics.add_failure("bad")
        assert before.counts == {"flows_out": 1}
        assert before.recent == before.arrivals_s == ()
        assert (before.last_failure, before.failures_in_a_row) == ("", 0)
        before.counts["flows_out"] = 100
        assert statistics.snapshot().counts["flows_out"] == 2

    def test_latency_percentiles(self):
        statistics = OnlineStatistics()
        for latency_ms in range(1, 101):
            statistics.add_estimate(float(latency_ms), make_estimate())
        snapshot = statistics.snapshot()
        assert snapshot.latency_ms(0) == 1.0
        assert snapshot.latency_ms(50) == 50.5
        assert snapshot.latency_ms(95) == pytest.approx(95.05)
        assert snapshot.latency_ms(100) == 100.0

    def test_only_recent_estimates_and_arrivals_are_kept(self):
        statistics = OnlineStatistics()
        for index in range(350):
            statistics.add_arrival()
            statistics.add_estimate(float(index), make_estimate())
        snapshot = statistics.snapshot()
        assert len(snapshot.recent) == len(snapshot.arrivals_s) == 100
        assert snapshot.recent[-1].latency_ms == 349.0
        assert snapshot.latency_ms(0) == 250.0
        assert list(snapshot.arrivals_s) == sorted(snapshot.arrivals_s)

    def test_of_an_estimate(self):
        statistics = OnlineStatistics()
        statistics.add_estimate(12.5, make_estimate(Start.COLD_GAP))
        (recent,) = statistics.snapshot().recent
        assert recent.latency_ms == 12.5
        assert recent.times_ms == {"prepare": 1.0, "forward": 2.0}
        assert recent.iterations == {"forward": 7}
        assert recent.stop_reasons == {"forward": "time_budget"}
        assert recent.start == "cold: gap since the last triplet"
        assert (recent.device, recent.distance_kind) == ("cpu", "tree")
        assert recent.precision == "bfloat16"
        assert recent.ego_source == ""

    def test_of_an_estimate_that_knows_how_the_sensor_moved(self):
        statistics, none = OnlineStatistics(), np.zeros((2, 3), np.float32)
        known = OverGround(none, none[:, 0] > 0, none[:, 0], np.eye(4), np.eye(4), "odometry")
        statistics.add_estimate(1.0, dataclasses.replace(make_estimate(), over_ground=known))
        assert statistics.snapshot().recent[-1].ego_source == "odometry"

    def test_does_not_keep_the_flow_itself_in_memory(self):
        assert "flow" not in {field.name for field in dataclasses.fields(StatisticsSnapshot)}
        statistics = OnlineStatistics()
        statistics.add_estimate(1.0, make_estimate())
        (recent,) = statistics.snapshot().recent
        assert not any(
            isinstance(getattr(recent, field.name), np.ndarray)
            for field in dataclasses.fields(recent)
        )


def test_failures_in_a_row_end_with_a_success():
    statistics = OnlineStatistics()
    statistics.add_failure("first")
    statistics.add_failure("second")
    assert statistics.snapshot().failures_in_a_row == 2
    assert statistics.snapshot().last_failure == "second"
    statistics.add_estimate(1.0, make_estimate())
    assert statistics.snapshot().failures_in_a_row == 0
    assert statistics.snapshot().last_failure == "second"


def test_no_count_of_many_threads_is_lost():
    statistics, num_threads, num_counts = OnlineStatistics(), 4, 2000

    def count():
        for _ in range(num_counts):
            statistics.count("event")
            statistics.snapshot()

    threads = [threading.Thread(target=count) for _ in range(num_threads)]
    for thread in threads:
        thread.start()
    for thread in threads:
        thread.join()
    assert statistics.snapshot().counts == {"event": num_threads * num_counts}
