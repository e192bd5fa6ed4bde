# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a stream takes for continuous, and what holds on."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.errors import SettingsError, SweepError
from mnsf_ros.stream import stream as stream_module
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Start, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import Arrival

NO_CUDA = pytest.mark.skipif(torch.cuda.is_available(), reason="needs a machine without CUDA")


class ShortMemory:
    """A method that remembers for a second; each flow says where it started."""

    def __init__(self, _name, settings):
        self.settings = settings
        self.traits = MethodTraits(num_sweeps=3, carries_state=True, max_gap_s=1.0)
        self._start = Start.COLD_FIRST

    def renewed(self, settings):
        return ShortMemory("", settings)

    def estimate(self, triplet, _cancelled=never):
        flow = np.zeros_like(triplet.current.xyz)
        estimate = FlowEstimate(flow, np.ones(len(flow), bool), start=self._start)
        self._start = Start.WARM
        return estimate


def failing(_settings):
    raise SweepError("none to be had")


@pytest.fixture
def short(monkeypatch, quick_settings):
    """A stream whose method remembers for a second."""
    monkeypatch.setattr(stream_module, "make_method", ShortMemory)
    return Stream(quick_settings.changed({"buffer.max_interval_s": 0.5}))


@pytest.fixture
def push(make_sweep):
    """Pushes sweeps by their numbers, ten a second; returns the starts of the flows."""

    def push_all(stream, *indices, frame_id="lidar"):
        flows = [stream.push(make_sweep(index, frame_id=frame_id)) for index in indices]
        return [flow and flow.start for flow in flows]

    return push_all


def test_flow_of_the_sweep_before_the_newest(quick_settings, make_sweep, motion):
    stream = Stream(quick_settings)
    sweeps = [make_sweep(index) for index in range(4)]
    assert [stream.push(sweep) for sweep in sweeps[:2]] == [None, None]
    for newest in (2, 3):
        flow = stream.push(sweeps[newest]).flow
        assert stream.triplet.sweeps == tuple(sweeps[newest - 2 : newest + 1])
        assert np.median(np.linalg.norm(flow - motion, axis=1)) < 0.1


class TestStretch:
    def test_goes_on_from_sweep_to_sweep(self, short, push):
        assert push(short, 0, 1, 2, 3, 4) == [None, None, Start.COLD_FIRST, Start.WARM, Start.WARM]

    @pytest.mark.parametrize(
        ("later", "frame_id", "start"),
        [
            ((11, 12, 13), "lidar", Start.WARM),
            ((13, 14, 15), "lidar", Start.COLD_GAP),
            ((-20, -19, -18), "lidar", Start.COLD_TIME_JUMP),
            ((3, 4, 5), "rear", Start.COLD_FRAME),
        ],
    )
    def test_ends_where_the_stream_breaks(self, short, push, later, frame_id, start):
        push(short, 0, 1, 2)
        assert push(short, *later, frame_id=frame_id) == [None, None, start]
        assert push(short, later[-1] + 1, frame_id=frame_id) == [Start.WARM]

    def test_ends_where_the_method_gets_no_triplet_for_too_long(self, short, push, make_sweep):
        """Nobody watched the flow meanwhile, or estimates took too long."""
        push(short, 0, 1, 2)
        for num_unwatched, start in ((12, Start.WARM), (13, Start.COLD_GAP)):
            newest = short.triplet.next.stamp_ns
            for index in range(1, num_unwatched):
                short.add(replace(make_sweep(0), stamp_ns=newest + index * 10**8))
            last = replace(make_sweep(0), stamp_ns=newest + num_unwatched * 10**8)
            assert short.push(last).start is start

    def test_ends_where_settings_of_the_estimates_change(self, short, push):
        push(short, 0, 1, 2)
        for number, (change, start) in enumerate(
            (
                ({"crop.max_range_m": 50.0}, Start.COLD_SETTINGS),
                ({"output.rgb": False}, Start.WARM),
                ({"buffer.max_interval_s": 0.4}, Start.WARM),
                ({"ego_motion.thinning_m": 0.4}, Start.COLD_SETTINGS),
            ),
            start=3,
        ):
            short.change_settings(short.settings.changed(change))
            assert push(short, number) == [start]

    def test_ends_although_the_next_triplet_fails(self, short, push, make_sweep):
        push(short, 0, 1, 2)
        for index in (13, 14):
            short.add(make_sweep(index))
        stays, short._estimator.renewed = short._estimator.renewed, failing
        with pytest.raises(SweepError, match="none to be had"):
            push(short, 15)
        short._estimator.renewed = stays
        assert push(short, 16, 17) == [Start.COLD_GAP, Start.WARM]


def test_a_sweep_that_is_refused_leaves_the_stream_as_it_was(short, push):
    assert push(short, 0, 1, 2, 1.5, 2, 3)[3:] == [None, None, Start.WARM]


class TestSettings:
    def test_of_the_buffer_hold_at_once(self, short, make_sweep, quick_settings):
        short.add(make_sweep(0))
        short.change_settings(quick_settings.changed({"buffer.max_interval_s": 0.05}))
        assert short.add(make_sweep(1)) is Arrival.GAP

    @pytest.mark.parametrize(
        ("change", "text"),
        [
            ({"method.name": "mnsf"}, "the method of a running stream is fixed"),
            pytest.param({"compute.device": "cuda"}, "compute.device: got 'cuda'", marks=NO_CUDA),
        ],
    )
    def test_that_are_refused_change_nothing(self, quick_settings, change, text):
        stream = Stream(quick_settings)
        with pytest.raises(SettingsError, match=text):
            stream.change_settings(quick_settings.changed(change))
        assert stream.settings == quick_settings


def test_a_variant_keeps_its_settings_when_others_change(quick_settings, make_sweep):
    stream = Stream(quick_settings, "paper/mnsf+fusion.kind=mean+optimization.max_iterations=2")
    sweeps = [make_sweep(index) for index in range(3)]
    for seed in (1, 2):
        stream.change_settings(quick_settings.changed({"compute.seed": seed}))
        # The mean has no weights to fit.
        assert stream.flow_of(SweepTriplet(*sweeps)).fits["fusion"].iterations == 0
