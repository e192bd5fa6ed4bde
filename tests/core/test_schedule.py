# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Number and size of the steps for each network, and the share of the time budget."""

from __future__ import annotations

import math
import time

import pytest

from mnsf_ros.core.schedule import Schedule, Schedules
from mnsf_ros.settings import Settings


def never():
    return False


def schedules(**changes):
    settings = Settings().changed({name.replace("__", "."): v for name, v in changes.items()})
    return Schedules.start_now(settings, never)


def test_decay_is_a_cosine_to_zero():
    schedule = Schedule(max_iterations=12, learning_rate=0.4, decay=True)
    # cos 0, 60, 90, 120 and 180 degrees.
    for iteration, rate in {0: 0.4, 4: 0.3, 6: 0.2, 8: 0.1, 12: 0.0}.items():
        assert schedule.learning_rate_at(iteration) == pytest.approx(rate, abs=1e-12)
    constant = Schedule(max_iterations=12, learning_rate=0.4)
    assert {constant.learning_rate_at(iteration) for iteration in range(12)} == {0.4}


def test_fields_and_fusion_have_their_own_steps_and_patience():
    chosen = schedules(
        optimization__max_iterations=70,
        optimization__learning_rate=0.03,
        early_stopping__patience=5,
        early_stopping__min_delta_m=0.25,
        fusion__max_iterations=30,
        fusion__patience=9,
    )
    parts = (*chosen.fields(2), chosen.fusion)
    assert [part.max_iterations for part in parts] == [70, 70, 30]
    assert [part.patience for part in parts] == [5, 5, 9]
    for part in parts:
        assert (part.learning_rate, part.min_delta_m) == (0.03, 0.25)
        assert part.decay is Settings().optimization.decay
        assert part.cancelled is never


def test_time_budget_is_shared_out_in_the_order_of_the_stages():
    before = time.monotonic()
    timed = schedules(optimization__time_budget_ms=500)
    after = time.monotonic()
    forward, backward = timed.fields(2)
    assert before < forward.deadline < backward.deadline < timed.fusion.deadline
    assert before + 0.5 <= timed.fusion.deadline <= after + 0.5
    assert schedules(optimization__time_budget_ms=0).fusion.deadline == math.inf
