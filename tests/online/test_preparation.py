# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The last sweeps made ready, and which of them an estimate looks back at."""

from __future__ import annotations

import itertools

import pytest
from box_street import BoxStreet, pose, stamp_ns, unrelated_sweep

from mnsf_ros.errors import SweepError
from mnsf_ros.online.preparation import Preparation
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

STREET = BoxStreet()
SETTINGS = Settings()


def sweep(index, **how):
    return STREET.sweep(pose(0.5 * index), index, points_per_box=100, **how)


def pairs_of(sweeps):
    return [SweepTriplet(None, *pair) for pair in itertools.pairwise(sweeps)]


def past_after(*indices, interval_s=0.1):
    """The last one of these sweeps made ready, and those that it looks back at."""
    preparation = Preparation(SETTINGS)
    for pair in pairs_of([sweep(index) for index in indices]):
        ready = preparation.prepare(pair)
    return ready.known[-1], ready.past(ready.known[-1], interval_s)


class TestPast:
    @pytest.mark.parametrize(
        ("indices", "expected"),
        [
            ((0, 1, 2, 3, 4, 5, 6, 7), [3, 6]),
            ((0, 1, 2, 3, 4, 5), [3, 5]),
            ((0, 2, 5), [3, 5]),
            ((1, 5), [4]),
            ((0, 5), [5]),
            ((2, 5), [3]),
            ((4, 5), []),
            ((0, 8), []),
        ],
    )
    def test_is_the_sweeps_nearest_to_three_and_six_tenths_of_a_second_ago(self, indices, expected):
        current, found = past_after(*indices)
        ages = [(current.stamp_ns - item.sweep.stamp_ns) / 1e8 for item in found]
        assert ages == expected
        assert [-item.time_ratio for item in found] == pytest.approx(expected)

    def test_is_not_the_previous_sweep_itself(self):
        """At three sweeps a second that of a third of a second ago is the previous one."""
        _, (found,) = past_after(0, 3, 6, interval_s=0.3)
        assert found.sweep.stamp_ns == stamp_ns(0)

    def test_is_unknown_without_stamps(self):
        assert past_after(0, 1, 2, 3, interval_s=0.0)[1] == []

    def test_reaches_no_farther_than_where_registration_failed(self):
        """Where the sensor was before that, beside where it is now, nobody knows."""
        preparation = Preparation(SETTINGS)
        sweeps = [unrelated_sweep(3) if index == 3 else sweep(index) for index in range(8)]
        found = {}
        for pair in pairs_of(sweeps):
            ready = preparation.prepare(pair)
            past = ready.past(ready.known[-1], interval_s=0.1)
            found[pair.next.stamp_ns] = [item.sweep.stamp_ns for item in past]
        for index, expected in ((4, []), (5, []), (6, [4]), (7, [4])):
            assert found[stamp_ns(index)] == list(map(stamp_ns, expected))


class TestReady:
    def test_each_sweep_once(self):
        preparation = Preparation(SETTINGS)
        sweeps = [sweep(index) for index in range(4)]
        first = preparation.prepare(SweepTriplet(*sweeps[:3])).of_triplet
        assert preparation.prepare(SweepTriplet(*sweeps[1:])).of_triplet[:2] == first[1:]

    def test_results_do_not_change(self):
        """Another thread estimates with it while later sweeps are made ready."""
        preparation = Preparation(SETTINGS)
        ready = preparation.prepare(SweepTriplet(sweep(0), sweep(1), sweep(2)))
        before = ready.known
        preparation.prepare(SweepTriplet(None, sweep(3), sweep(4)))
        preparation.prepare(SweepTriplet(None, sweep(5), sweep(6)))
        assert ready.known is before
        assert ready.of_triplet == before
        assert len(before) == 3

    def test_memory_is_bounded_where_every_triplet_is_refused(self):
        preparation = Preparation(SETTINGS)
        sweeps = [sweep(index) for index in range(36)]
        sweeps = [
            Sweep(each.xyz[:5], each.stamp_ns, each.frame_id) if index % 3 == 2 else each
            for index, each in enumerate(sweeps)
        ]
        for first in range(len(sweeps) - 2):
            with pytest.raises(SweepError, match="points are left"):
                preparation.prepare(SweepTriplet(*sweeps[first : first + 3]))
        assert len(preparation._sweeps) <= 12
