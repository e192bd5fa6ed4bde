# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A method is treated by what it says of itself, not by how it is called."""

from __future__ import annotations

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.methods import registry

# Stamps of the sweeps that were estimated.
SEEN_NS = []


class Counting:
    """The flow says how many triplets the estimator has seen, if it carries that on."""

    def __init__(self, settings, traits):
        self.settings, self.traits = settings, traits
        self._count = 0

    def with_settings(self, settings):
        return Counting(settings, self.traits)

    def estimate(self, triplet, cancelled=never):
        if triplet.current.stamp_ns >= small.FIRST_NS:
            SEEN_NS.append(triplet.current.stamp_ns)
            self._count += self.traits.carries_state
        flow = np.full_like(triplet.current.xyz, self._count)
        return FlowEstimate(flow, np.ones(len(flow), bool))


@pytest.fixture(params=[True, False], ids=["stateful", "stateless"])
def carries_state(request, monkeypatch):
    traits = MethodTraits(num_sweeps=2, carries_state=request.param)
    make = lambda settings: Counting(settings, traits)  # noqa: E731
    monkeypatch.setitem(registry._METHODS, "toy", make)
    SEEN_NS.clear()
    return request.param


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 8)


def rows_of(task, options):
    return [row for row in run_task(task, options) if isinstance(row, ResultRow)]


def plain(rows):
    return [small.without_times(row) for row in rows]


def test_sampling_skips_examples_only_where_nothing_is_carried_on(bag, carries_state):
    task = small.task_at(bag, "toy")
    whole = rows_of(task, small.options())
    SEEN_NS.clear()
    sampled = rows_of(task, small.options(every=3))
    assert plain(sampled) == plain(whole)[::3]
    assert len(SEEN_NS) == (6 if carries_state else 2)
