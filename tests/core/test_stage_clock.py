# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of stages."""

from types import SimpleNamespace

import pytest

from mnsf_ros.core import stage_clock
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.errors import CancelledError


def test_clock_ends_a_cancelled_estimate_before_the_next_stage():
    answers = iter([False, True])
    clock = StageClock(cancelled=lambda: next(answers))
    with clock.stage("forward"):
        pass
    with pytest.raises(CancelledError, match=r"^the estimate was cancelled$"):
        clock.stage("backward").__enter__()
    assert list(clock.times_ms) == ["forward"]


def test_clock_adds_up_the_blocks_of_a_stage(monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr(stage_clock, "time", SimpleNamespace(perf_counter=lambda: now_s[0]))
    clock = StageClock()
    for duration_s in (1.0, 0.25):
        with clock.stage("forward"):
            now_s[0] += duration_s
        now_s[0] += 8.0
    with clock.stage("fusion"):
        now_s[0] += 0.5
    assert clock.times_ms == {"forward": 1250.0, "fusion": 500.0}
