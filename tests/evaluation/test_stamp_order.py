# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

from dataclasses import dataclass

import pytest

from mnsf_ros.evaluation.tracks import in_stamp_order


@dataclass(frozen=True)
class Item:
    stamp_ns: int


def ordered(stamps, window=4):
    items = [None if stamp is None else Item(stamp) for stamp in stamps]
    return [None if item is None else item.stamp_ns for item in in_stamp_order(items, window)]


@pytest.mark.parametrize(
    ("received", "expected"),
    [
        ([], []),
        ([3], [3]),
        ([1, 2, 3], [1, 2, 3]),
        ([2, 1, 4, 3, 6, 5], [1, 2, 3, 4, 5, 6]),
        ([5, 4, 3, 2, 1], [1, 2, 3, 4, 5]),
        ([1, 1, 1], [1, 1, 1]),
    ],
)
def test_small_disorder_is_put_in_order(received, expected):
    assert ordered(received) == expected


def test_nothing_moves_across_a_gap():
    assert ordered([2, 1, None, 4, 3, None]) == [1, 2, None, 3, 4, None]


def test_order_begins_anew_after_a_jump_back():
    # A recording that loops: the second round must not be sorted into the first.
    first, second = [100, 101, 102, 103, 104, 105, 106], [1, 3, 2, 4, 5, 6, 7]
    assert ordered([*first, *second]) == [*first, *sorted(second)]


def test_a_straggler_beyond_the_window_comes_late_but_comes():
    assert sorted(ordered([10, 11, 12, 13, 14, 15, 5, 16], window=2)) == sorted(
        [10, 11, 12, 13, 14, 15, 5, 16]
    )


def test_only_the_window_is_held_back():
    taken = []

    def items():
        for stamp in range(100):
            taken.append(stamp)
            yield Item(stamp)

    results = in_stamp_order(items(), window=3)
    assert next(results).stamp_ns == 0
    assert len(taken) == 4


def test_items_of_equal_stamp_need_not_be_comparable():
    class Plain:
        stamp_ns = 1

    assert len(list(in_stamp_order([Plain(), Plain(), Plain()]))) == 3
