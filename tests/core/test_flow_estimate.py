# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times, and results shown in one line."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np

from mnsf_ros.core import flow_estimate
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround, StageClock, TrackedObject


def test_large_results_are_shown_in_one_line():
    num_points = 50_000
    walker = TrackedObject(
        7, np.zeros(3), np.ones(3), 0.0, np.array([1.2, 0.0, 0.0]), np.eye(6), 1.0, 40
    )
    over_ground = OverGround(
        motion=np.zeros((num_points, 3), np.float32),
        dynamic=np.arange(num_points) < 40,
        confidence=np.ones(num_points, np.float32),
        world_from_sensor=np.eye(4),
        next_from_current=np.eye(4),
        source="registration",
        objects=(walker,) * 30,
    )
    estimate = FlowEstimate(
        flow=np.zeros((num_points, 3), np.float32),
        kept=np.ones(num_points, bool),
        times_ms={"prepare": 1.5, "forward": 2.0},
        over_ground=over_ground,
    )
    shown = "points=50000, dynamic=40, objects=30, "
    assert repr(estimate) == f"FlowEstimate({shown}time=3.5 ms)"
    assert repr(over_ground) == f"OverGround({shown}source='registration')"
    assert repr(walker) == "TrackedObject(track_id=7, speed=1.2 m/s, num_points=40)"
    plain = FlowEstimate(np.zeros((2, 3), np.float32), np.ones(2, bool))
    assert repr(plain) == "FlowEstimate(points=2, time=0.0 ms)"


def test_clock_adds_up_the_blocks_of_a_stage(monkeypatch):
    now_s = [0.0]
    monkeypatch.setattr(flow_estimate, "time", SimpleNamespace(perf_counter=lambda: now_s[0]))
    clock = StageClock()
    for duration_s in (1.0, 0.25):
        with clock.stage("forward"):
            now_s[0] += duration_s
        now_s[0] += 8.0
    with clock.stage("fusion"):
        now_s[0] += 0.5
    assert clock.times_ms == {"forward": 1250.0, "fusion": 500.0}
