"""What an estimate tells about itself."""

from __future__ import annotations

import time

import numpy as np

from mnsf_ros.core.flow_estimate import (
    FlowEstimate,
    OptimizationResult,
    StageClock,
    Start,
    StopReason,
)


def test_time_and_words():
    estimate = FlowEstimate(
        flow=np.zeros((1, 3), np.float32),
        kept=np.ones(1, bool),
        times_ms={"prepare": 1.5, "forward": 2.0},
        fits={
            "forward": OptimizationResult(0.1, 5, StopReason.CONVERGED),
            "backward": OptimizationResult(0.2, 6, StopReason.TIME_BUDGET),
        },
        start=Start.WARM,
        device="cpu",
        distance_kind="tree",
    )
    assert estimate.time_ms == 3.5
    assert estimate.stop_reasons == {"forward": "converged", "backward": "time_budget"}


def test_clock_adds_up_the_blocks_of_a_stage(device):
    clock = StageClock()
    for _ in range(2):
        with clock.stage("forward"):
            time.sleep(0.01)
    with clock.stage("fusion"):
        pass
    assert list(clock.times_ms) == ["forward", "fusion"]
    assert clock.times_ms["forward"] >= 20
    assert 0 <= clock.times_ms["fusion"] < clock.times_ms["forward"]
