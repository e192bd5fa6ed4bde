# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Told are: no flow though clouds come, dropped triplets, and clouds that nobody has seen."""

from __future__ import annotations

from collections import Counter

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.online import watches
from mnsf_ros.online.online_statistics import RecentEstimate, StatisticsSnapshot
from mnsf_ros.online.watches import FlowWatch, MissedClouds

PATIENCE_S = 2.0
PERIOD_S = 0.5


class Node:
    """Counters that grow, looked at in a regular period."""

    def __init__(self):
        self._watch = FlowWatch()
        self._counts = Counter()
        self._now_s = 100.0

    def goes_on(self, duration_s, *events):
        """What was said of a time in which these events happened once a period."""
        said = []
        for _ in range(round(duration_s / PERIOD_S)):
            self._now_s += PERIOD_S
            self._counts.update(events)
            now = StatisticsSnapshot(self._counts.copy())
            said.append(self._watch.look(now, self._now_s, PATIENCE_S).complaint)
        return said


@pytest.fixture
def node():
    return Node()


@pytest.mark.parametrize(
    ("events", "words"),
    [
        (("sweeps_received", "sweeps_frame_changed"), "frame_id changes"),
        (("sweeps_received", "sweeps_duplicate"), "the same stamp"),
        (("sweeps_received", "sweeps_out_of_order"), "go backwards"),
        (("sweeps_received", "sweeps_time_went_back"), "jump back"),
        (("sweeps_received", "sweeps_gap"), "buffer.max_interval_s"),
        (("clouds_undecodable",), "cannot be decoded"),
        (("clouds_empty",), "no finite point"),
        (("sweeps_received", "triplets_formed", "estimates_failed"), "every estimate fails"),
        (("sweeps_received", "triplets_formed", "triplets_dropped"), "takes too long"),
    ],
)
def test_the_reason_names_the_counter(node, events, words):
    said = node.goes_on(PATIENCE_S + 2 * PERIOD_S, *events)
    assert said[:-1] == len(said[:-1]) * [""]
    assert words in said[-1]
    assert f"(see {events[-1]})" in said[-1]


def test_the_most_frequent_reason_since_the_last_flow_is_told(node):
    node.goes_on(60, "sweeps_received", "sweeps_gap", "flows_out")
    node.goes_on(1, "sweeps_received", "sweeps_gap")
    said = node.goes_on(10, "sweeps_received", "sweeps_duplicate")
    assert "sweeps_duplicate" in said[-1]


@pytest.mark.parametrize("well", ["flows_out", "triplets_unwatched"])
def test_all_is_well_while_flow_comes_or_nobody_watches(node, well):
    assert set(node.goes_on(60, "sweeps_received", "triplets_formed", well)) == {""}


def test_a_lidar_that_is_silent_is_no_fault_of_the_flow(node):
    node.goes_on(1, "sweeps_received", "flows_out")
    assert set(node.goes_on(60)) == {""}
    # Nor are the first sweeps after it.
    assert set(node.goes_on(1, "sweeps_received")) == {""}
    assert set(node.goes_on(60, "sweeps_received", "flows_out")) == {""}


def snapshot(flows=0, dropped=0, estimate_ms=None):
    recent = ()
    if estimate_ms is not None:
        times_ms = {"prepare": estimate_ms - 50.0, "search": 50.0}
        none = np.zeros((0, 3), np.float32)
        recent = (RecentEstimate(9.9, 0.0, FlowEstimate(none, none[:, 0] > 0, times_ms)),)
    counts = Counter(flows_out=flows, triplets_dropped=dropped)
    arrivals_s = tuple(index / 10 for index in range(101)) if recent else ()
    return StatisticsSnapshot(counts, recent, arrivals_s)


@pytest.fixture(autouse=True)
def _load(monkeypatch):
    monkeypatch.setattr(watches.os, "getloadavg", lambda: (4.26, 1.0, 1.0))
    monkeypatch.setattr(watches.os, "cpu_count", lambda: 2)


def busy(watch, now, now_s):
    return watch.look(now, now_s, PATIENCE_S).busy


def test_number_reason_and_remedy():
    assert busy(FlowWatch(), snapshot(18, 42, estimate_ms=170.0), 10.0) == (
        "CPU busy: 18 of 60 flows (an estimate takes 170 ms, sweeps come every 100 ms, load 4.3 on "
        "2 cores). Close other programs, or lower crop.max_range_m."
    )


def test_drops_are_told_once():
    watch, asked = FlowWatch(), ((5, 0), (5, 5), (15, 5), (15, 6))
    said = [busy(watch, snapshot(*counts), float(s)) for s, counts in enumerate(asked)]
    assert [bool(text) for text in said] == [False, True, False, True]


def test_numbers_are_those_of_the_last_ten_seconds():
    watch = FlowWatch()
    said = [busy(watch, snapshot(7 * second, 3 * second), float(second)) for second in range(30)]
    assert said[-1].startswith("CPU busy: 70 of 100 flows")


INTERVAL_NS = 10**8


class ByNumber:
    """The numbers tell; the stamps say nothing."""

    @staticmethod
    def arguments(index):
        return index, 0


class ByStamp:
    """The middleware gives no numbers; the lidar is a little irregular."""

    @staticmethod
    def arguments(index):
        return None, 10**9 + index * INTERVAL_NS + (index * 7 % 5) * 10**6


@pytest.fixture(params=[ByNumber, ByStamp], ids=["by number", "by stamp"])
def way(request):
    return request.param


def missed(way, indices, num_publishers=1):
    """How many clouds are missing before each of these."""
    counter = MissedClouds()
    return [counter.before(*way.arguments(index), num_publishers) for index in indices]


@pytest.mark.parametrize("gap", [0, 1, 7])
def test_gaps_are_counted_where_they_are(way, gap):
    indices = [*range(1, 31), *range(31 + gap, 61), *range(61 + gap, 71)]
    found = missed(way, indices)
    assert found[30] == found[30 + 30 - gap] == gap
    assert sum(found) == 2 * gap


@pytest.mark.parametrize(("first", "num_missed"), [(1, 0), (32, 31)])
def test_a_publisher_that_starts_anew_begins_at_one(first, num_missed):
    found = missed(ByNumber, [*range(500, 540), *range(first, first + 30)])
    assert found == [*40 * [0], num_missed, *29 * [0]]


@pytest.mark.parametrize("is_expected", [True, False])
def test_the_first_clouds_of_a_publisher_are_missed_if_it_has_just_appeared(is_expected):
    counter = MissedClouds()
    if is_expected:
        counter.expect_a_new_publisher()
    assert [counter.before(number, 0, 1) for number in (32, 33, 35)] == [31 * is_expected, 0, 1]


def test_with_two_publishers_there_is_no_telling(way):
    assert sum(missed(way, range(1, 400, 3), num_publishers=2)) == 0


@pytest.mark.parametrize(
    "indices",
    [[1, 2, 3, 9, 10], [*range(40), 100_000, 100_001], [*range(500, 540), *range(1, 30)]],
    ids=["few", "a long pause", "a new start"],
)
def test_stamps_that_tell_nothing(indices):
    assert sum(missed(ByStamp, indices)) == 0
