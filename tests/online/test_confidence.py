# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How sure a motion is: of a flat side that slides along itself it is a guess."""

from __future__ import annotations

import numpy as np
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.online.confidence import moving_confidence
from mnsf_ros.online.motions import judge, residual_rise_m
from mnsf_ros.online.target import Targets

MOTION = np.array([0.6, 0.0, 0.0], np.float32)
CAR = {"center": (10.0, 6.0, 0.0), "size": (4.0, 1.8, 1.5)}
# Seen between two things that hide its ends.
SIDE = {"center": (10.0, 6.0, 0.0), "size": (4.0, 0.05, 1.5)}


def confidence_of(box, motion=MOTION, *, moved=MOTION, score=6.0):
    """Confidence in a motion of a box that moved otherwise, or whose ends are never seen."""
    center, size = np.array(box["center"]), box["size"]
    current = prepared(surface(center, size=size))
    objects = objects_of(current)

    def seen(steps):
        return target(prepared(surface(center + steps * moved, size=size)), current, steps)

    targets = Targets((seen(1.0), seen(-1.0)), (seen(-3.0),))
    moving = judge(objects, targets, rows(motion))
    rise_m = residual_rise_m(objects, moving, targets)
    return moving_confidence(moving, np.full(len(objects), score), rise_m)


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
    assert 1 - confidences[2] > 1.8 * (1 - confidences[0])


def test_what_was_seen_to_move_is_surer():
    fast = {"motion": 5 * MOTION, "moved": 5 * MOTION}
    assert confidence_of(CAR, **fast, score=9.0) > confidence_of(CAR, **fast, score=1.0)
