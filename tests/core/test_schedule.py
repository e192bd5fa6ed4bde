# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How long each network is optimized, and with which steps."""

from __future__ import annotations

import math
import time

import pytest

from mnsf_ros.core.schedule import Schedule, Schedules
from mnsf_ros.settings import Settings


def never():
    return False


def schedules(is_warm=False, **changes):
    names = {name.replace("__", "."): value for name, value in changes.items()}
    return Schedules.start_now(Settings().changed(names), is_warm=is_warm, cancelled=never)


def test_decay_is_a_cosine_from_all_to_nothing():
    schedule = Schedule(max_iterations=12, learning_rate=0.4, decay=True)
    # cos 0, 60, 90, 120 and 180 degrees.
    for iteration, rate in {0: 0.4, 4: 0.3, 6: 0.2, 8: 0.1, 12: 0.0}.items():
        assert schedule.learning_rate_at(iteration) == pytest.approx(rate, abs=1e-12)


def test_steps_stay_the_same_without_decay():
    schedule = Schedule(max_iterations=12, learning_rate=0.4)
    assert {schedule.learning_rate_at(iteration) for iteration in range(12)} == {0.4}


def test_cold_start():
    cold = schedules(
        optimization__max_iterations=70,
        optimization__learning_rate=0.03,
        early_stopping__patience=5,
        early_stopping__min_delta_m=0.25,
        fusion__max_iterations=30,
        fusion__patience=9,
    )
    assert (cold.forward.max_iterations, cold.backward.max_iterations) == (70, 70)
    assert (cold.forward.patience, cold.backward.patience) == (5, 5)
    assert (cold.fusion.max_iterations, cold.fusion.patience) == (30, 9)
    for schedule in (cold.forward, cold.backward, cold.fusion):
        assert (schedule.learning_rate, schedule.min_delta_m) == (0.03, 0.25)
        assert schedule.decay is Settings().optimization.decay
        assert schedule.cancelled is never


def test_warm_start_is_shorter_and_gentler():
    warm = schedules(
        is_warm=True,
        warm_start__max_iterations=7,
        warm_start__learning_rate=0.001,
        early_stopping__patience=5,
        fusion__patience=9,
    )
    for schedule in (warm.forward, warm.backward, warm.fusion):
        assert (schedule.max_iterations, schedule.learning_rate) == (7, 0.001)
    assert (warm.forward.patience, warm.fusion.patience) == (5, 9)


def test_time_budget_is_shared_out_in_the_order_of_the_stages():
    before = time.monotonic()
    timed = schedules(optimization__time_budget_ms=500)
    after = time.monotonic()
    assert timed.forward.deadline < timed.backward.deadline < timed.fusion.deadline
    assert before + 0.5 <= timed.fusion.deadline <= after + 0.5
    assert timed.forward.deadline > before


def test_no_time_budget():
    unhurried = schedules(optimization__time_budget_ms=0)
    for schedule in (unhurried.forward, unhurried.backward, unhurried.fusion):
        assert schedule.deadline == math.inf
