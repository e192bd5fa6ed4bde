# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.outcomes import attempted, replayed
from mnsf_ros.evaluation.scoring import DROPPED
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

EMPTY = np.empty((0, 3), np.float32)


def example(number, next_ms):
    def sweep(milliseconds):
        return Sweep(EMPTY, round(milliseconds * 1e6))

    triplet = SweepTriplet(sweep(next_ms - 200), sweep(next_ms - 100), sweep(next_ms))
    return Example("drive", number, triplet)


class Work:
    """A clock, and a method that takes the given times by it."""

    def __init__(self, estimate_ms, prepare_ms):
        self.now_s = 0.0
        self.settings = Settings()
        self.traits = MethodTraits(num_sweeps=3)
        self._estimate_ms, self._prepare_ms = iter(estimate_ms), prepare_ms

    def clock_s(self):
        return self.now_s

    def renewed(self, _settings):
        return self

    def prepare(self, triplet):
        self.now_s += self._prepare_ms / 1e3
        return triplet.current.stamp_ns

    def estimate(self, triplet, _cancelled=never, prepared=None, _effort=None):
        assert prepared == triplet.current.stamp_ns
        self.now_s += next(self._estimate_ms) / 1e3
        return FlowEstimate(EMPTY, np.empty(0, bool))


@pytest.fixture
def played(monkeypatch):
    """Number and latency of each outcome, in their order; None for those that were dropped."""

    def play(arrivals_ms, times_ms, rate=1.0, prepare_ms=0.0):
        work = Work(times_ms, prepare_ms)
        monkeypatch.setattr("mnsf_ros.stream.stream.make_method", lambda *_: work)
        examples = [example(number, next_ms) for number, next_ms in enumerate(arrivals_ms)]
        outcomes = list(replayed(Stream(Settings()), examples, rate, work.clock_s))
        return [
            (o.example.number, None if o.result is DROPPED else round(o.latency_ms, 3))
            for o in outcomes
        ]

    return play


@pytest.mark.parametrize(
    ("arrivals_ms", "times_ms", "rate", "outcomes"),
    [
        # A fast method gets everything at once.
        ([1000, 1100, 1200], 60, 1.0, {0: 60, 1: 60, 2: 60}),
        # 0 runs 1000 to 1250. 1 waits at 1100, 2 takes its place at 1200 and runs 1250 to 1500.
        # 3 waits at 1300, 4 takes its place at 1400; it runs at 1500, just before 5 arrives,
        # to 1750; 5 waits, 6 and 7 take its place in turn; 7 runs 1750 to 2000.
        (
            range(1000, 1800, 100),
            250,
            1.0,
            {0: 250, 1: None, 2: 300, 3: None, 4: 350, 5: None, 6: None, 7: 300},
        ),
        # What still waits at the end is estimated.
        ([1000, 1100], 150, 1.0, {0: 150, 1: 200}),
        # At double speed sweeps come every 50 ms.
        ([1000, 1100, 1200, 1300], 60, 2.0, {0: 60, 1: 70, 2: 80, 3: 90}),
        ([1000, 1100, 1200, 1300], 110, 2.0, {0: 110, 1: None, 2: 120, 3: 180}),
        # A recording that jumps back goes on.
        ([1000, 1100, 100, 200], 10, 1.0, {0: 10, 1: 10, 2: 10, 3: 10}),
    ],
)
def test_a_busy_method_gets_the_newest_when_it_is_done(
    played, arrivals_ms, times_ms, rate, outcomes
):
    assert dict(played(arrivals_ms, [times_ms] * 8, rate)) == outcomes


def test_preparation_overlaps_with_the_estimate_before_it(played):
    """Together they take longer than the interval, each for itself does not."""
    outcomes = played(range(0, 1000, 100), [90] * 10, prepare_ms=80)
    assert outcomes == [(number, 170) for number in range(10)]


def test_slow_preparation_lets_two_wait_in_order_and_then_the_newest(played):
    # 0 is prepared until 250 while 1 and 2 wait; then 1 until 500 while 2 and 3 wait. 4 comes on
    # top and is replaced by 5, 6 and 7 in turn; these are prepared after 2 and 3, at 1000.
    outcomes = played(range(0, 800, 100), [10] * 8, prepare_ms=250)
    given = {number: latency for number, latency in outcomes if latency is not None}
    assert given == {0: 260, 1: 410, 2: 560, 3: 710, 7: 560}
    assert sorted(number for number, _ in outcomes) == list(range(8))


def test_failures_are_told_and_interruptions_go_through():
    def fail(cause):
        raise SystemError("a compiled loop has met an exception") from cause

    assert attempted(lambda: fail(None)) == "SystemError: a compiled loop has met an exception"
    with pytest.raises(KeyboardInterrupt):
        attempted(lambda: fail(KeyboardInterrupt()))
