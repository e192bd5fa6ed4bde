# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps are prepared, estimated and handed out at once, which changes no flow."""

import threading
import time

import numpy as np
import pytest
from pipelines import PATIENCE_S, Gate, assert_balanced, counts_of

from mnsf_ros.core.flow_estimate import Effort, FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.methods import make_method
from mnsf_ros.stream import stream
from mnsf_ros.sweeps.sweep import SweepTriplet


class Script:
    """What the estimators of a test do, and what they did."""

    def __init__(self):
        self.at_prepare, self.at_estimate = Gate(), Gate()
        self.prepared, self.estimated, self.made = [], [], []

    def make(self, _name, settings):
        return ScriptedEstimator(self, settings)


class ScriptedEstimator:
    """Flow is zero. Each of its two parts may be used by one thread at a time only."""

    traits = MethodTraits(num_sweeps=3, carries_state=True)

    def __init__(self, script, settings):
        self.settings = settings
        self._script = script
        self._in_prepare, self._in_estimate = threading.Lock(), threading.Lock()
        script.made.append(self)

    def renewed(self, settings):
        return ScriptedEstimator(self._script, settings)

    def prepare(self, triplet):
        assert self._in_prepare.acquire(blocking=False), "prepares twice at once"
        try:
            self._script.at_prepare.go_through()
            stamp_ns = triplet.next.stamp_ns
            self._script.prepared.append(stamp_ns)
            return self, stamp_ns
        finally:
            self._in_prepare.release()

    def estimate(self, triplet, cancelled=never, prepared=None, effort=Effort.FULL):
        assert self._in_estimate.acquire(blocking=False), "estimates twice at once"
        try:
            assert prepared == (self, triplet.next.stamp_ns)
            self._script.at_estimate.go_through(cancelled)
            self._script.estimated.append(triplet.next.stamp_ns)
            points = triplet.current.xyz
            return FlowEstimate(np.zeros_like(points), np.ones(len(points), bool))
        finally:
            self._in_estimate.release()


@pytest.fixture
def script():
    return Script()


@pytest.fixture
def pipeline(script, make_pipeline, monkeypatch, quick_settings):
    """A pipeline of scripted estimators."""
    monkeypatch.setattr(stream, "make_method", script.make)
    yield make_pipeline(quick_settings)
    script.at_prepare.let_go()
    script.at_estimate.let_go()


@pytest.fixture
def add(make_sweep):
    def add_sweeps(pipeline, *indices):
        for index in indices:
            pipeline.add_sweep(make_sweep(index), time.monotonic_ns())

    return add_sweeps


@pytest.fixture
def held(add):
    """Adds sweeps, the last of which is held up at a gate."""

    def add_and_hold(gate, pipeline, *indices):
        gate.hold()
        add(pipeline, *indices)
        assert gate.is_reached.wait(PATIENCE_S)

    return add_and_hold


def stamp_ns(index):
    return 10**9 + index * 10**8


def stamps(*indices):
    return [stamp_ns(index) for index in indices]


def test_a_dropped_triplet_was_prepared_in_its_turn(pipeline, script, add, held, wait_until):
    held(script.at_estimate, pipeline, 0, 1, 2)
    for index in range(3, 9):
        add(pipeline, index)
        wait_until(lambda: script.prepared[-1] == stamp_ns(index))  # noqa: B023 - called at once
    wait_until(lambda: pipeline.load == 2)
    script.at_estimate.let_go()
    wait_until(lambda: pipeline.load == 0)
    assert script.prepared == stamps(2, 3, 4, 5, 6, 7, 8)
    assert script.estimated == stamps(2, 8)
    assert counts_of(pipeline)["triplets_dropped"] == 5
    assert_balanced(pipeline)


def test_sweeps_faster_than_their_preparation_are_dropped_before_it_and_the_newest_wins(
    pipeline, script, add, held, wait_until
):
    held(script.at_prepare, pipeline, 0, 1, 2)
    add(pipeline, *range(3, 20))
    assert pipeline.load == 4
    assert counts_of(pipeline)["triplets_dropped"] == 14
    script.at_prepare.let_go()
    wait_until(lambda: pipeline.load == 0)
    assert script.prepared == stamps(2, 3, 4, 19)
    assert script.estimated[-1] == stamp_ns(19)
    assert_balanced(pipeline)


def test_flows_faster_than_their_output_are_dropped_and_the_newest_wins(
    pipeline, script, add, held, recorder, wait_until
):
    held(recorder.gate, pipeline, 0, 1, 2)
    for index in range(3, 9):
        add(pipeline, index)
        wait_until(lambda: script.estimated[-1] == stamp_ns(index))  # noqa: B023 - called at once
    wait_until(lambda: pipeline.load == 2)
    recorder.gate.let_go()
    wait_until(lambda: pipeline.load == 0)
    assert recorder.current_stamps == stamps(1, 7)
    assert counts_of(pipeline)["triplets_dropped"] == 5
    assert_balanced(pipeline)


def test_a_triplet_that_waits_while_settings_change_keeps_those_it_was_prepared_with(
    pipeline, script, add, held, quick_settings, wait_until
):
    held(script.at_estimate, pipeline, 0, 1, 2)
    add(pipeline, 3)
    wait_until(lambda: script.prepared == stamps(2, 3))
    pipeline.change_settings(quick_settings.changed({"objects.cell_size_m": 0.4}))
    script.at_estimate.let_go()
    wait_until(lambda: pipeline.load == 0)
    assert len(script.made) == 1
    add(pipeline, 4)
    wait_until(lambda: pipeline.load == 0)
    assert script.prepared == script.estimated == stamps(2, 3, 4)
    assert [made.settings.objects.cell_size_m for made in script.made][1:] == [0.4]


def test_other_settings_end_an_estimate_that_would_last_for_hours(
    pipeline, script, add, held, quick_settings, wait_until
):
    held(script.at_estimate, pipeline, 0, 1, 2)
    add(pipeline, 3)
    pipeline.change_settings(quick_settings.changed({"objects.cell_size_m": 0.4}))
    wait_until(lambda: counts_of(pipeline)["triplets_abandoned"] == 1)
    script.at_estimate.let_go()
    wait_until(lambda: pipeline.load == 0)
    assert script.estimated == stamps(3)
    assert_balanced(pipeline)


class TestReset:
    def test_abandons_all_that_is_under_way(self, pipeline, script, add, held, wait_until):
        held(script.at_estimate, pipeline, 0, 1, 2)
        add(pipeline, 3)
        wait_until(lambda: script.prepared == stamps(2, 3))
        held(script.at_prepare, pipeline, 4)
        add(pipeline, 5)
        pipeline.reset()
        script.at_prepare.let_go()
        wait_until(lambda: pipeline.load == 0)
        assert script.estimated == []
        assert counts_of(pipeline)["triplets_abandoned"] == 4
        script.at_estimate.let_go()
        add(pipeline, 6, 7, 8)
        wait_until(lambda: pipeline.load == 0)
        assert script.estimated == stamps(8)
        assert_balanced(pipeline)

    def test_forgets_a_flow_that_waits_for_its_output(
        self, pipeline, script, add, held, recorder, wait_until
    ):
        held(recorder.gate, pipeline, 0, 1, 2)
        add(pipeline, 3)
        wait_until(lambda: script.estimated == stamps(2, 3) and pipeline.load == 2)
        pipeline.reset()
        recorder.gate.let_go()
        wait_until(lambda: pipeline.load == 0)
        assert recorder.current_stamps == stamps(1)
        assert counts_of(pipeline)["triplets_abandoned"] == 1
        assert_balanced(pipeline)


class TestClose:
    def test_while_a_sweep_is_prepared_hands_out_nothing_any_more(
        self, pipeline, script, held, recorder
    ):
        held(script.at_prepare, pipeline, 0, 1, 2)
        assert pipeline.close(0.0) is False
        script.at_prepare.let_go()
        assert pipeline.close(PATIENCE_S) is True
        assert script.estimated == recorder.handed_out == []


class TestFlowOfTheOnlineMethod:
    """The pipeline gives what a plain loop gives, bit for bit."""

    @pytest.fixture
    def offline(self, quick_settings, make_sweep):
        def flows_of(*last_indices, prepared_only=()):
            estimator = make_method("online", quick_settings)
            sweeps = [make_sweep(index) for index in range(max(last_indices) + 1)]
            for last in range(2, len(sweeps)):
                triplet = SweepTriplet(*sweeps[last - 2 : last + 1])
                if last in prepared_only:
                    estimator.prepare(triplet)
                if last in last_indices:
                    yield estimator.estimate(triplet)

        return flows_of

    @staticmethod
    def assert_same(recorder, expected):
        for (_, flow), other in zip(recorder.handed_out, expected, strict=True):
            np.testing.assert_array_equal(flow.flow, other.flow)
            np.testing.assert_array_equal(flow.over_ground.dynamic, other.over_ground.dynamic)
            np.testing.assert_array_equal(flow.over_ground.confidence, other.over_ground.confidence)
            np.testing.assert_array_equal(flow.over_ground.track_ids, other.over_ground.track_ids)
            assert flow.start is other.start

    @pytest.fixture
    def gated(self, script, make_pipeline, monkeypatch, quick_settings):
        """A pipeline whose estimates begin behind the gate of the script."""

        def make(name, settings):
            estimator = make_method(name, settings)
            prepare, estimate = estimator.prepare, estimator.estimate

            def prepare_and_tell(triplet):
                prepared = prepare(triplet)
                script.prepared.append(triplet.next.stamp_ns)
                return prepared

            def estimate_behind_gate(*arguments):
                script.at_estimate.go_through()
                return estimate(*arguments)

            estimator.prepare, estimator.estimate = prepare_and_tell, estimate_behind_gate
            return estimator

        monkeypatch.setattr(stream, "make_method", make)
        yield make_pipeline(quick_settings)
        script.at_estimate.let_go()

    def test_after_dropped_triplets(self, gated, script, add, held, recorder, offline, wait_until):
        """A dropped triplet leaves no gap in ego motion and older sweeps."""
        held(script.at_estimate, gated, 0, 1, 2)
        for index in range(3, 8):
            add(gated, index)
            wait_until(lambda: script.prepared[-1] == stamp_ns(index))  # noqa: B023 - as above
        # The last one, too, has taken the place of the one before it.
        wait_until(lambda: gated.load == 2)
        script.at_estimate.let_go()
        wait_until(lambda: gated.load == 0)
        assert recorder.current_stamps == stamps(1, 6)
        self.assert_same(recorder, offline(2, 7, prepared_only=range(3, 7)))
