"""Gaps in the numbers of a publisher, or in the stamps, are clouds that nobody has seen."""

from __future__ import annotations

import pytest

from mnsf_ros.online.watches import MissedClouds

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


def test_nothing_is_missing_in_a_row(way):
    assert missed(way, range(50, 100)) == 50 * [0]


@pytest.mark.parametrize("gap", [1, 2, 7])
def test_gaps_are_counted_where_they_are(way, gap):
    indices = [*range(1, 31), *range(31 + gap, 61), *range(61 + gap, 71)]
    found = missed(way, indices)
    assert found[30] == found[30 + 30 - gap] == gap
    assert sum(found) == 2 * gap


def test_a_publisher_that_starts_anew_has_no_gap(way):
    assert sum(missed(way, [*range(500, 540), *range(1, 30)])) == 0


def test_with_two_publishers_there_is_no_telling(way):
    assert sum(missed(way, range(1, 400, 3), num_publishers=2)) == 0


def test_a_publisher_that_takes_over_has_no_gap():
    counter = MissedClouds()
    found = [counter.before(number, 0, 1) for number in (5, 6)]
    found += [counter.before(number, 0, 2) for number in (7, 900)]
    found += [counter.before(number, 0, 1) for number in (901, 903)]
    assert found == [0, 0, 0, 0, 0, 1]


def test_few_stamps_and_long_pauses_tell_nothing():
    assert sum(missed(ByStamp, [1, 2, 3, 9, 10])) == 0
    assert sum(missed(ByStamp, [*range(40), 100_000, 100_001])) == 0


def test_stamps_that_stand_still_tell_nothing():
    counter = MissedClouds()
    assert sum(counter.before(None, 10**9, 1) for _ in range(60)) == 0
    assert sum(counter.before(None, 0, 1) for _ in range(60)) == 0
