# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.online.online_statistics import OnlineStatistics, rate_hz


@pytest.mark.parametrize(
    ("times_s", "now_s", "rate"),
    [
        ([], 10.0, 0.0),
        ([10.0], 10.0, 0.0),
        ([3.0, 3.0], 3.0, 0.0),
        ([0.0, 0.1, 1.0, 2.0], 2.0, 1.5),
        # 2 intervals in 1 s, and the silence beyond one interval.
        ([0.0, 0.5, 1.0], 4.0, 2 / 3.5),
        ([0.0, 0.5, 1.0], 101.0, 2 / 100.5),
    ],
)
def test_rate_falls_in_silence(times_s, now_s, rate):
    assert rate_hz(times_s, now_s) == pytest.approx(rate)


def make_estimate():
    return FlowEstimate(np.zeros((2, 3), np.float32), np.ones(2, bool))


class TestSnapshot:
    def test_does_not_change(self):
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
        assert statistics.snapshot().counts["flows_out"] == 2

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
