# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Limits of the decision, where boundaries of the folder show them only on long drives."""

from __future__ import annotations

import numpy as np
import pytest
from small_scenes import objects_of, prepared, rows, surface, target

from mnsf_ros.objects.decision import moves
from mnsf_ros.objects.motion_fusion import judge
from mnsf_ros.objects.motion_memory import Expectation
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.objects.target import Targets
from mnsf_ros.settings import Settings

MOTION = np.array([0.8, 0.0, 0.0], np.float32)
PLACE = np.array([30.0, 2.0, 0.0])


@pytest.mark.parametrize(
    ("track", "evidence", "dynamic"),
    [
        (MOTION, 3.0, True),
        (MOTION, -1.0, False),
        (-MOTION, 3.0, False),
    ],
    ids=["seen to move so", "not seen to move", "seen to move otherwise"],
)
def test_what_goes_along_with_the_sensor_moves_if_its_track_did(track, evidence, dynamic):
    current = prepared(surface(PLACE))
    targets = Targets(
        [target(prepared(surface(PLACE + step * MOTION)), current, step) for step in (1.0, -1.0)],
        [target(prepared(surface(PLACE - 3 * MOTION)), current, -3.0)],
    )
    objects = objects_of(current)
    expected = Expectation(
        np.ones(1, np.bool_), rows(track), np.full(1, evidence), np.full(1, evidence)
    )
    suspects = Suspects(np.arange(1), objects, judge(objects, targets, rows((0, 0, 0))), expected)
    moving = judge(objects, targets, rows(MOTION))
    are_beams, scores = np.ones(1, np.bool_), np.full(1, 4.0)
    called = moves(suspects, moving, are_beams, scores, 0.1, Settings().objects)
    assert called.tolist() == [dynamic]
