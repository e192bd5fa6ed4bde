# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How sure a motion is: of a flat side that slides along itself it is a guess."""

from __future__ import annotations

import numpy as np
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.objects.confidence import moving_confidence
from mnsf_ros.objects.motion_fusion import judge
from mnsf_ros.objects.motion_memory import Expectation
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.target import Targets

MOTION = np.array([0.6, 0.0, 0.0], np.float32)
CAR = {"center": (10.0, 6.0, 0.0), "size": (4.0, 1.8, 1.5)}
# Seen between two things that hide its ends.
SIDE = {"center": (10.0, 6.0, 0.0), "size": (4.0, 0.05, 1.5)}


def confidence_of(box, motion=MOTION, *, moved=MOTION, expected=None, track_score=3.0):
    """Confidence in a motion of a box that moved otherwise, or whose ends are never seen."""
    center, size = np.array(box["center"]), box["size"]
    current = prepared(surface(center, size=size))
    objects = objects_of(current)

    def seen(steps):
        return target(prepared(surface(center + steps * moved, size=size)), current, steps)

    targets = Targets((seen(1.0), seen(-1.0)), (seen(-3.0),))
    known = np.full(len(objects), expected is not None)
    motions = rows((0, 0, 0) if expected is None else expected)
    standing = judge(objects, targets, rows((0, 0, 0)))
    expectation = Expectation(known, motions, np.where(known, track_score, 0.0))
    movers = Suspects(np.arange(len(objects)), objects, standing, expectation)
    moving = judge(objects, targets, rows(motion))
    return moving_confidence(movers, moving, np.full(len(objects), 6.0), targets)


def test_a_car_with_ends_is_surer_than_a_side_without():
    # A side without ends looks the same wherever it slid to.
    side = confidence_of(SIDE, moved=np.zeros(3, np.float32))
    assert confidence_of(CAR) > 0.95
    assert side < confidence_of(CAR) - 0.05


def test_the_longer_a_motion_the_more_places_match_by_chance():
    confidences = [
        confidence_of(CAR, motion=length * MOTION, moved=length * MOTION) for length in (1, 3, 6)
    ]
    assert sorted(confidences, reverse=True) == confidences
    assert 1 - confidences[2] > 5 * (1 - confidences[0])


def test_a_track_that_was_seen_to_move_confirms_a_motion():
    fast = {"motion": 5 * MOTION, "moved": 5 * MOTION}
    new = confidence_of(CAR, **fast)
    # One that is only followed, because it may move, says nothing.
    assert confidence_of(CAR, **fast, expected=5 * MOTION, track_score=-1.0) == new
    assert confidence_of(CAR, **fast, expected=5 * MOTION) > new
