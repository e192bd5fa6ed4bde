# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A pipeline that drops triplets does less for each, and all of it when that has passed."""

import time

import numpy as np
import pytest
from pipelines import PATIENCE_S, Gate, assert_balanced, counts_of

from mnsf_ros.core.flow_estimate import Effort, FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.stream import stream
from mnsf_ros.stream.load_control import LoadControl

FULL, NEAR, HALF, LEAST = Effort


class Adapting:
    """Its flow is zero, with the effort that it is asked for."""

    traits = MethodTraits(num_sweeps=3)
    gate = Gate()

    def __init__(self, _name, settings):
        self.settings = settings

    def renewed(self, settings):
        return Adapting("", settings)

    def prepare(self, triplet):
        return triplet

    def estimate(self, triplet, cancelled=never, prepared=None, effort=FULL):
        self.gate.go_through(cancelled)
        points = triplet.current.xyz
        return FlowEstimate(np.zeros_like(points), np.ones(len(points), bool), effort=effort)


@pytest.fixture
def efforts(make_pipeline, monkeypatch, quick_settings, make_sweep, recorder, wait_until):
    """The efforts of eleven estimates, a sweep at a time, of one with drops, and of the next."""
    monkeypatch.setattr(stream, "make_method", Adapting)

    def efforts_of(**changes):
        pipeline = make_pipeline(quick_settings.changed(changes))

        def add(*indices):
            for index in indices:
                pipeline.add_sweep(make_sweep(index), time.monotonic_ns())

        for index in range(12):
            add(index)
            wait_until(lambda: pipeline.load == 0)
        Adapting.gate.hold()
        add(12)
        assert Adapting.gate.is_reached.wait(PATIENCE_S)
        add(*range(13, 20))
        Adapting.gate.let_go()
        wait_until(lambda: pipeline.load == 0)
        add(20)
        wait_until(lambda: pipeline.load == 0)
        assert counts_of(pipeline)["triplets_dropped"] > 1
        assert_balanced(pipeline)
        return [estimate.effort for _, estimate in recorder.handed_out]

    yield efforts_of
    Adapting.gate.let_go()


def test_drops_lower_the_effort_by_one_at_once(efforts):
    found = efforts()
    assert found[:11] == 11 * [FULL]
    assert set(found[12:]) == {NEAR}


def test_the_effort_stays_if_the_settings_say_so(efforts):
    assert set(efforts(**{"compute.adapt": False})) == {FULL}


def after(control, *events):
    """The effort after numbers of estimates, each followed by a drop."""
    for number in events:
        for _ in range(number):
            control.count_estimate()
        control.count_drop()
    return control.effort


class TestControl:
    def test_the_first_estimates_may_be_slow(self):
        assert after(LoadControl(), 0, 2, 2) is FULL

    def test_goes_down_where_more_triplets_are_dropped_than_estimated(self):
        control = LoadControl()
        assert after(control, *(6 * [0, 1, 0])) is NEAR
        assert after(control, *(20 * [0, 1, 0])) is LEAST

    def test_goes_down_as_long_as_that_does_not_help(self):
        control = LoadControl()
        assert [after(control, 5) for _ in range(4)] == [NEAR, HALF, LEAST, LEAST]

    def test_comes_back_step_by_step(self):
        control = LoadControl()
        after(control, 5, 5)
        seen = []
        for _ in range(100):
            control.count_estimate()
            seen.append(control.effort)
        assert [seen.count(effort) for effort in (HALF, NEAR, FULL)] == [49, 50, 1]

    def test_tries_more_rarely_what_has_failed(self):
        control, waits = LoadControl(), []
        after(control, 5)
        for _ in range(6):
            number = 0
            while control.effort is NEAR:
                control.count_estimate()
                number += 1
            waits.append(number)
            after(control, 5)
        assert waits == [50, 100, 200, 400, 800, 800]

    def test_soon_again_once_it_has_held(self):
        control = LoadControl()
        after(control, 5, 55)
        assert after(control, 100 + 100 + 5) is NEAR
        for _ in range(50):
            control.count_estimate()
        assert control.effort is FULL
