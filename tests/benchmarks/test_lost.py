# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The benchmark of an ego motion that doubts itself: what is wrong, what is said, and recovery."""

import math
from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround

SENSOR, SPEED_M_S = "16 beams, ±15°", 8.0


@pytest.fixture(scope="module")
def lost_drives(load):
    """The disturbances, in short drives."""
    module = load("lost_drives")
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(module, "_BEFORE", 8)
        patch.setattr(module, "_AFTER", 8)
        patch.setitem(module.SENSORS, SENSOR, (15.0, 16, 300, False))
        yield module


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
            *(np.eye(4), taken.motion_to(following)),
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
        ({"off_m": range(7, 11)}, (0, 4, 0, 3)),
        ({"off_m": range(7, 11), "lost": range(9, 12)}, (2, 2, 1, 4)),
        ({"lost": range(7, 9)}, (0, 0, 2, 1)),
        # A stream without an estimate is not wrong, and not right either.
        ({"silent": range(7, 11)}, (0, 0, 0, 3)),
        # Right for a sweep or two is not right again.
        ({"off_m": (8, 11)}, (0, 2, 0, 4)),
        ({"off_m": range(7, 99)}, (0, 8, 0, math.inf)),
    ],
)
def test_what_is_wrong_and_what_is_said_is_counted(lost_scores, gap, errors, expected):
    score = lost_scores.score(gap, Oracle(gap.sweeps, **errors).push)
    found = score.wrong_said, score.wrong_unsaid, score.right_said, score.sweeps_until_right
    assert found == expected
    assert score.sweeps == len(gap.sweeps) - 4 - len(errors.get("silent", ()))


def test_a_stream_that_calls_everything_dynamic_is_wrong_and_does_not_say_so(lost_scores, gap):
    every = range(len(gap.sweeps))
    score = lost_scores.score(gap, Oracle(gap.sweeps, dynamic=every).push)
    assert score.wrong_unsaid == score.sweeps > 0 == score.ego_unsaid
    assert score.sweeps_until_right == math.inf
    said = lost_scores.score(gap, Oracle(gap.sweeps, dynamic=every, lost=every).push)
    assert (said.wrong_said, said.wrong_unsaid) == (said.sweeps, 0)


def interval_s(drive):
    return np.diff([each.sweep.stamp_ns for each in drive.sweeps]) / 1e9


def turns_deg(drive):
    ahead = np.array([each.pose_at(0.0)[:2, 0] for each in drive.sweeps])
    return np.degrees(np.diff(np.unwrap(np.arctan2(ahead[:, 1], ahead[:, 0]))))


def steps_m(drive):
    return np.linalg.norm(
        np.diff([each.pose_at(0.0)[:3, 3] for each in drive.sweeps], axis=0), axis=1
    )


def are_repeated(drive):
    return [np.array_equal(a.sweep.xyz, b.sweep.xyz) for a, b in pairwise(drive.sweeps)]


def ranges_m(drive):
    return np.array([np.median(np.linalg.norm(each.sweep.xyz, axis=1)) for each in drive.sweeps])


# Of the first variant of each disturbance: what has happened to its 8 sweeps before, and after.
HAPPENED = {
    "gap": lambda drive: interval_s(drive)[7] == pytest.approx(0.2),
    "frozen": lambda drive: are_repeated(drive) == [False] * 7 + [True] * 3 + [False] * 8,
    "start": lambda drive: steps_m(drive)[:20].max() == 0.0 < steps_m(drive)[-1] - 0.15,
    "turn": lambda drive: np.allclose(turns_deg(drive)[8:14], 15.0, atol=0.5),
    "push": lambda drive: (steps_m(drive)[8:10] > steps_m(drive)[6] + 0.002).all(),
    "rate": lambda drive: np.allclose(interval_s(drive), 0.5),
    "bus": lambda drive: np.ptp([each.static.mean() for each in drive.sweeps]) > 0.3,
    "cover": lambda drive: (np.flatnonzero(ranges_m(drive) < 0.6) == range(8, 18)).all(),
    "door": lambda drive: ranges_m(drive)[-1] < ranges_m(drive)[0],
}


@pytest.mark.parametrize("name", HAPPENED)
def test_a_disturbance_does_what_it_says_and_its_truth_is_right(lost_drives, lost_scores, name):
    assert set(HAPPENED) == set(lost_drives.DISTURBANCES)
    place = "rooms" if name == "door" else "street"
    speed_m_s = 0.0 if place == "rooms" else SPEED_M_S
    drive = next(lost_drives.drives(lost_drives.Case(name, place, SENSOR, speed_m_s, 0)))
    assert HAPPENED[name](drive)
    score = lost_scores.score(drive, Oracle(drive.sweeps).push)
    assert score.wrong_said == score.wrong_unsaid == score.right_said == 0 < score.sweeps
    every = range(len(drive.sweeps))
    still = lost_scores.score(drive, Oracle(drive.sweeps, dynamic=every).push)
    assert still.wrong_unsaid == still.sweeps == score.sweeps


@pytest.mark.parametrize("sensor", [SENSOR, f"{SENSOR}, rolling"])
@pytest.mark.parametrize("pushed", [{}, {"turn_deg_s": 300.0}, {"push_m_s": 2.0}])
def test_static_points_flow_as_the_simulator_says(lost_drives, pushed, sensor):
    case = lost_drives.Case("turn", "street", sensor, SPEED_M_S, 0)

    def change(scene):
        return replace(
            scene, ego=lost_drives.Thrown.of(scene.ego, begin_s=0.0, end_s=0.5, **pushed)
        )

    place = lost_drives.Place(case, change)
    truth = place._simulator.sweep(2).truth
    taken, following = place.taken(range(2, 4))
    flow = taken.static_flow(following)
    assert np.abs(flow - truth.flow)[taken.static].max() < 0.06
    assert np.median(np.abs(flow - truth.flow)[taken.static]) < 1e-5


def test_tables_have_the_figures_of_kinds_and_cells_and_targets(load, lost_scores):
    lost = load("lost")
    cases = [lost.Case("gap", "street", SENSOR, speed, 20) for speed in (8.0, 15.0)]
    scores = [(100, 3, 1, 1, 2, 4.0), (100, 0, 9, 0, 0, math.inf)]
    lines = [
        lost.Line(case, "1 s", lost_scores.Score(*score))
        for case, score in zip(cases, scores, strict=True)
    ]
    steady = lost_scores.Score(200, 0, 0, 0, 0, math.nan)
    lines.append(lost.Line(cases[0]._replace(disturbance="rate"), "5 Hz", steady))
    cells, kinds, targets = lost.lost_tables(lines)
    assert [row[0] for row in cells.rows] == [
        *(f"gap, 1 s: street, {SENSOR}, {speed} m/s" for speed in (8, 15)),
        f"rate, 5 Hz: street, {SENSOR}, 8 m/s",
    ]
    assert [row[1:] for row in kinds.rows] == [
        ["200", "3", "10", "1", "2", "inf/inf"],
        ["200", "0", "0", "0", "0", ""],
        ["400", "3", "10", "1", "2", "inf/inf"],
    ]
    assert [row[2:] for row in targets.rows] == [
        ["0.025", "MISSED"],
        ["0.0025", "MISSED"],
        ["inf", "MISSED"],
        ["inf", "MISSED"],
    ]
