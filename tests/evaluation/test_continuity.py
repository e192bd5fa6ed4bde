# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps that do not fit their neighbours are counted, where no damage says so."""

from __future__ import annotations

import pytest

from mnsf_ros.evaluation.findings import Continuity

STEP_NS = 100_000_000


def continuity_of(stamps, sizes=None, interrupted_after=()):
    continuity = Continuity(0.5)
    for number, stamp in enumerate(stamps):
        continuity.add(round(stamp * STEP_NS), 1000 if sizes is None else sizes[number])
        if stamp in interrupted_after:
            continuity.interrupt()
    return continuity


@pytest.mark.parametrize(
    ("missing", "count"),
    [((), 0), ((5,), 1), ((5, 6), 2), ((5, 8), 2), ((0,), 0), ((4, 5, 6, 7, 8), 0)],
)
def test_missing_sweeps_are_counted_up_to_the_largest_interval(missing, count):
    assert continuity_of([i for i in range(12) if i not in missing]).num_missing == count


def test_an_unsteady_clock_is_no_loss():
    assert continuity_of([0, 1.2, 2, 3.3, 4, 4.9, 6]).num_missing == 0


def test_what_is_known_to_be_missing_is_not_told_again():
    stamps = [0, 1, 2, 3, 5, 6, 7, 9, 10]
    assert continuity_of(stamps, interrupted_after=[3]).num_missing == 1
    assert continuity_of(stamps, interrupted_after=[3, 7]).num_missing == 0


def test_few_sweeps_have_no_usual_interval():
    assert continuity_of([0, 1, 3]).num_missing == 0


def test_jumps_back_and_equal_stamps_are_no_loss():
    assert continuity_of([0, 1, 2, 3, 1, 2, 3, 4]).num_missing == 0
    assert continuity_of([0] * 8).num_missing == 0
    assert continuity_of([]).num_missing == 0


@pytest.mark.parametrize(
    ("sizes", "count"),
    [
        ([100, 90, 100, 110], 0),
        ([100, 49, 100, 100], 1),
        ([100, 100, 201, 100], 1),
        ([100, 60, 40, 20, 10], 0),
        ([100, 0, 100, 0, 100], 3),
        ([100], 0),
        ([], 0),
    ],
)
def test_sizes_that_jump_are_counted(sizes, count):
    assert continuity_of(range(len(sizes)), sizes).num_jumps == count
