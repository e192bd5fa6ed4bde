# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The last sweeps made ready, and which of them an estimate looks back at."""

from __future__ import annotations

import re

import pytest
from box_street import BoxStreet, pose, stamp_ns, unrelated_sweep

from mnsf_ros.errors import SweepError
from mnsf_ros.objects.prepared_sweeps import PreparedSweeps
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep

STREET = BoxStreet()
SETTINGS = Settings()


def sweep(index, **how):
    return STREET.sweep(pose(0.5 * index, yaw_deg=2 * index), index, points_per_box=100, **how)


def past_after(*indices, interval_s=0.1):
    """The last one of these sweeps made ready, and those that it looks back at."""
    prepared = PreparedSweeps(SETTINGS)
    for index in indices:
        ready = prepared.ready(sweep(index))
    return ready.last[-1], ready.past(ready.last[-1], interval_s)


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
            ((5,), []),
        ],
    )
    def test_is_the_sweeps_nearest_to_three_and_six_tenths_of_a_second_ago(self, indices, expected):
        current, found = past_after(*indices)
        ages = [(current.sweep.stamp_ns - item.sweep.sweep.stamp_ns) / 1e8 for item in found]
        assert ages == expected
        assert [-item.steps for item in found] == pytest.approx(expected)

    def test_is_not_the_previous_sweep_itself(self):
        """At three sweeps a second that of a third of a second ago is the previous one."""
        _, (found,) = past_after(0, 3, 6, interval_s=0.3)
        assert found.sweep.sweep.stamp_ns == stamp_ns(0)

    def test_steps_are_intervals_of_the_flow(self):
        _, (found,) = past_after(0, 1, 2, 3, interval_s=0.15)
        assert found.steps == pytest.approx(-2)

    def test_is_unknown_without_stamps(self):
        assert past_after(0, 1, 2, 3, interval_s=0.0)[1] == []

    def test_reaches_no_farther_than_where_registration_failed(self):
        """Where the sensor was before that, beside where it is now, nobody knows."""
        prepared = PreparedSweeps(SETTINGS)
        prepared.ready(*(sweep(index) for index in (0, 1, 2)))
        prepared.ready(unrelated_sweep(3))
        for index, expected in ((4, []), (5, []), (6, [4]), (7, [4])):
            ready = prepared.ready(sweep(index))
            found = ready.past(ready.last[-1], interval_s=0.1)
            assert [item.sweep.sweep.stamp_ns for item in found] == list(map(stamp_ns, expected))

    def test_reaches_no_farther_than_the_world(self):
        prepared = PreparedSweeps(SETTINGS)
        worlds = [prepared.ready(sweep(index)).world for index in (0, 1, 2)]
        ready = prepared.ready(sweep(3, frame_id="other"))
        assert ready.past(ready.last[-1], 0.1) == []
        assert [*worlds, ready.world] == [1, 1, 1, 2]


class TestReady:
    def test_each_sweep_once(self):
        prepared = PreparedSweeps(SETTINGS)
        sweeps = [sweep(index) for index in range(4)]
        first = prepared.ready(*sweeps[:3]).of_triplet
        assert prepared.ready(*sweeps[1:]).of_triplet[:2] == first[1:]

    def test_what_was_handed_out_does_not_change(self):
        """Another thread estimates with it while later sweeps are made ready."""
        prepared = PreparedSweeps(SETTINGS)
        ready = prepared.ready(sweep(0), sweep(1), sweep(2))
        before = ready.last
        prepared.ready(sweep(3))
        prepared.ready(*(sweep(index, frame_id="other") for index in (4, 5, 6)))
        assert ready.last is before
        assert ready.of_triplet == before
        assert len(before) == 3

    def test_only_the_last_ones_are_kept(self):
        prepared = PreparedSweeps(SETTINGS)
        for index in range(15):
            last = prepared.ready(sweep(index)).last
        assert [each.sweep.stamp_ns for each in last] == [stamp_ns(index) for index in range(3, 15)]

    def test_memory_is_bounded_where_every_triplet_is_refused(self):
        prepared = PreparedSweeps(SETTINGS)
        sweeps = [sweep(index) for index in range(36)]
        sweeps = [
            Sweep(each.xyz[:5], each.stamp_ns, each.frame_id) if index % 3 == 2 else each
            for index, each in enumerate(sweeps)
        ]
        for first in range(len(sweeps) - 2):
            with pytest.raises(SweepError, match="points are left"):
                prepared.ready(*sweeps[first : first + 3])
        assert len(prepared._sweeps) <= 12

    @pytest.mark.parametrize(
        "odd", [{"index": 30}, {"index": 0.5}, {"index": 2, "frame_id": "other"}]
    )
    def test_sweeps_of_two_worlds_are_refused(self, odd):
        prepared = PreparedSweeps(SETTINGS)
        text = "the sweeps of the triplet do not follow each other"
        with pytest.raises(SweepError, match=f"^{re.escape(text)}"):
            prepared.ready(sweep(0), sweep(1), sweep(**odd))
        following = [sweep(index) for index in (40, 41, 42)]
        assert len(prepared.ready(*following).of_triplet) == 3
