# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One case of each disturbance: the ego motion is right or says that it is lost, and comes back."""

import math
from itertools import islice

import pytest

CASES = [
    ("gap", "street", "32 beams, ±25°", 8.0, 0),
    ("frozen", "street", "16 beams, ±15°", 8.0, 0),
    # Here, the ego motion stayed at 0 for ever.
    ("start", "street", "16 beams, ±15°", 1.8, 20),
    ("turn", "rooms", "32 beams, ±45°", 0.0, 0),
    ("push", "street", "32 beams, ±25°", 8.0, 0),
    ("rate", "carried", "32 beams, ±45°", 0.0, 0),
    ("bus", "street", "16 beams, ±15°", 1.8, 0),
    ("cover", "rooms", "32 beams, ±25°", 0.0, 0),
    ("door", "rooms", "16 beams, ±15°", 0.0, 0),
]


@pytest.mark.slow
@pytest.mark.parametrize("case", CASES, ids=[case[0] for case in CASES])
def test_it_is_right_or_lost(load, case):
    drives, scores = load("lost_drives"), load("lost_scores")
    found = [scores.score(drive) for drive in islice(drives.drives(drives.Case(*case)), 2)]
    assert found
    for score in found:
        assert score.ego_unsaid <= 2
        assert math.isnan(score.sweeps_until_right) or score.sweeps_until_right <= 5
        # What is right is mostly believed; frozen clouds of a robot that stands are not.
        assert score.right_said <= (6 if case[0] != "frozen" else score.sweeps)
