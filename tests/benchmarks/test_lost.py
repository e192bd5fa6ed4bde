# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The benchmark of an ego motion that doubts itself: what is wrong, what is said, and recovery."""

import math
from itertools import pairwise

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.geometry.transforms import invert

SENSOR, SPEED_M_S = "16 beams, ±15°", 8.0


@pytest.fixture(scope="module")
def lost_drives(load):
    return load("lost_drives")


@pytest.fixture(scope="module")
def lost_scores(load):
    return load("lost_scores")


class Oracle:
    """A stream that knows the motion of the sensor, with errors in some sweeps."""

    def __init__(self, sweeps, off_m=(), dynamic=(), lost=(), silent=()):
        self._sweeps = list(pairwise(sweeps))
        self._taken, self._bad = 0, (off_m, dynamic, lost, silent)

    def push(self, sweep):
        number = self._taken - 1
        self._taken += 1
        off_m, dynamic, lost, silent = (number in each for each in self._bad)
        if number < 0 or silent:
            return None
        taken, following = self._sweeps[number]
        assert following.sweep is sweep
        flow = taken.static_flow(following) + (0.2, 0.0, 0.0) * np.array(off_m)
        each = np.ones(len(flow), bool)
        over_ground = OverGround(
            np.zeros_like(flow),
            each & dynamic,
            each.astype(np.float32),
            *(taken.pose, invert(following.pose) @ taken.pose),
            "test",
            lost="no overlap" if lost else "",
        )
        return FlowEstimate(flow, each, over_ground=over_ground)


@pytest.fixture(scope="module")
def gap(lost_drives):
    """A gap of a second."""
    drives = lost_drives.drives(lost_drives.Case("gap", "street", SENSOR, SPEED_M_S, 0))
    return next(each for each in drives if each.variant == "1 s")


@pytest.mark.parametrize(
    ("errors", "expected"),
    [
        ({}, (0, 0, 0, 0)),
        ({"off_m": range(14, 20)}, (0, 6, 0, 5)),
        ({"off_m": range(14, 20), "lost": range(16, 22)}, (4, 2, 2, 7)),
        ({"lost": range(14, 16)}, (0, 0, 2, 1)),
        # A stream without an estimate is not wrong, and not right either.
        ({"silent": range(14, 18)}, (0, 0, 0, 3)),
        # Right for a sweep or two is not right again.
        ({"off_m": (15, 18)}, (0, 2, 0, 4)),
        ({"off_m": range(14, 99)}, (0, 25, 0, math.inf)),
    ],
)
def test_what_is_wrong_and_what_is_said_is_counted(lost_scores, gap, errors, expected):
    score = lost_scores.score(gap, Oracle(gap.sweeps, **errors).push)
    wrong_said, wrong_unsaid, right_said, sweeps_until_right = expected
    found = score.wrong_said, score.wrong_unsaid, score.right_said, score.sweeps_until_right
    assert found == (wrong_said, wrong_unsaid, right_said, sweeps_until_right)
    assert score.sweeps == len(gap.sweeps) - 4 - len(errors.get("silent", ()))


def test_a_stream_that_calls_everything_dynamic_is_wrong_and_does_not_say_so(lost_scores, gap):
    every = range(len(gap.sweeps))
    score = lost_scores.score(gap, Oracle(gap.sweeps, dynamic=every).push)
    assert score.wrong_unsaid == score.sweeps > 0 == score.ego_unsaid
    assert score.sweeps_until_right == math.inf
    said = lost_scores.score(gap, Oracle(gap.sweeps, dynamic=every, lost=every).push)
    assert (said.wrong_said, said.wrong_unsaid) == (said.sweeps, 0)
