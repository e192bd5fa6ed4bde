# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Scores of movers: points, false movers, objects over time."""

import math
from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround, TrackedObject
from mnsf_ros.core.reason import Reason, Verdict
from mnsf_ros.evaluation.movers import LostBy, MoverRow, ObjectRow, TrueMotion, mover_row
from mnsf_ros.evaluation.run_folder import from_json, to_json
from mnsf_ros.evaluation.scoring import ResultRow, scored_row
from mnsf_ros.evaluation.summary import FAST, SLOW, summarize
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.report.tables import further_tables, main_tables

N = 100
SECOND = 1_000_000_000


def true_motion(ids, speeds):
    """Points 10 m ahead; object i moves to the left at a speed."""
    velocity = np.zeros((len(ids), 3))
    velocity[:, 1] = [speeds.get(i, 0.0) for i in ids]
    return TrueMotion(
        xyz=np.tile(np.float32([10, 0, 0]), (len(ids), 1)),
        velocity=velocity,
        dynamic=velocity[:, 1] > 0.5,
        class_id=np.where(ids > 0, SurfaceClass.CAR, 0).astype(np.uint8),
        object_id=ids,
    )


def said(dynamic, *, tracks=None, confidence=0.97, motion=None, objects=()):
    n = len(dynamic)
    return OverGround(
        motion=np.zeros((n, 3), np.float32) if motion is None else motion,
        dynamic=dynamic,
        confidence=np.full(n, confidence, np.float32),
        world_from_sensor=np.eye(4),
        next_from_current=np.eye(4),
        source="registration",
        objects=objects,
        track_ids=tracks,
    )


def track(number, velocity, age_s=1.0):
    box = (np.zeros(3), np.ones(3), 0.0)
    return TrackedObject(number, *box, np.array(velocity, float), 0.0, np.eye(6), age_s, 50)


def summary_of(rows):
    """The scores of recordings, stamps and movers."""
    rows = [ResultRow(name, ns, ns, "online", N, movers=movers) for name, ns, movers in rows]
    summary = summarize(rows).loc["online"]
    return {k.removeprefix("movers."): v for k, v in summary.items() if k.startswith("movers.")}


def groups_in(summary):
    return {name.removesuffix(".delay_s") for name in summary if name.endswith(".delay_s")}


def row_of(truth, over_ground):
    return mover_row(truth, over_ground, np.arange(len(truth.xyz)))


IDS = np.repeat([0, 1, 2], [20, 40, 40])


def test_points_are_counted_and_objects_found():
    called = np.zeros(N, bool)
    called[5:60] = True  # 15 static ones, all of object 1, none of object 2
    row = row_of(true_motion(IDS, {1: 5.0, 2: 1.0}), said(called))
    assert row.points == (40, 15, 40)
    first, second = row.objects
    assert (first.object_id, first.kind, first.moves, first.called) == (1, "car", True, 1.0)
    assert (first.speed_m_s, first.range_m, first.num_points) == (5.0, 10.0, 40)
    assert first.is_found
    assert not second.is_found
    summary = summary_of([("drive", 0, row)])
    assert summary["precision"] == pytest.approx(40 / 55)
    assert summary["recall"] == 0.5
    assert summary["iou"] == pytest.approx(40 / 95)


@pytest.mark.parametrize(
    ("speeds_m_s", "called", "points", "objects"),
    [
        # A parked object that is called moving is a false mover, and has a row.
        ({1: 5.0}, IDS == 2, (0, 40, 40), [(1, True), (2, False)]),
        # A mover below the limit of dynamic points is neither wrong nor missed.
        ({1: 0.3, 2: 0.2}, IDS > 0, (0, 40, 0), [(1, False), (2, False)]),
    ],
)
def test_false_mover(speeds_m_s, called, points, objects):
    tracks = np.where(called, IDS, 0).astype(np.int32)
    row = row_of(true_motion(IDS, speeds_m_s), said(called, tracks=tracks))
    assert (row.num_ghosts, row.points) == (1, points)
    assert [(item.object_id, item.moves) for item in row.objects] == objects
    summary = summary_of([("drive", 0, row), ("drive", 1, replace(row, num_ghosts=0))])
    assert (summary["ghosts_per_sweep"], summary["ghost_sweeps"]) == (0.5, 0.5)


def test_motions_without_tracks_are_ghosts_each():
    motion = np.zeros((N, 3), np.float32)
    motion[:10, 0], motion[10:20, 0], motion[20:29, 0] = 1, 2, 3
    called = np.arange(N) < 29  # the last nine are too few
    assert row_of(true_motion(IDS * 0, {}), said(called, motion=motion)).num_ghosts == 2
    # Most points of the first one move in truth.
    ids = np.where(np.arange(N) < 6, 1, 0)
    assert row_of(true_motion(ids, {1: 3.0}), said(called, motion=motion)).num_ghosts == 1


@pytest.mark.parametrize(
    ("velocity", "age_s", "error_m_s", "error_deg"),
    [
        ((0, 5.5, 0), 1.0, 0.5, 0.0),
        ((5, 0, 0), 0.5, math.sqrt(50), 90.0),
        ((0, 9, 0), 0.4, math.nan, math.nan),  # not followed for long enough
    ],
)
def test_velocity_is_that_of_the_tracked_object(velocity, age_s, error_m_s, error_deg):
    tracks = np.where(IDS == 1, 3, 0).astype(np.int32)
    objects = (track(3, velocity, age_s), track(4, (0, 0, 0)))
    row = row_of(true_motion(IDS, {1: 5.0}), said(IDS == 1, tracks=tracks, objects=objects))
    summary = summary_of([("drive", 0, row)])
    assert summary["velocity_error_m_s"] == pytest.approx(error_m_s, nan_ok=True)
    assert summary["direction_error_deg"] == pytest.approx(error_deg, nan_ok=True, abs=1e-4)


def seen(found, speed_m_s=5.0, *, moves=True, object_id=1, range_m=10.0):
    item = ObjectRow(object_id, "car", moves, speed_m_s, range_m, 50, float(found))
    return MoverRow((1, 0, 0), 0, objects=[item])


def at_10_hz(rows, name="drive"):
    return [(name, number * SECOND // 10, row) for number, row in enumerate(rows)]


def group_of(rows):
    """Movers, mover-sweeps, share found, flicker and delay of the fast ones."""
    summary = summary_of(rows)
    figures = ("num_movers", "num_sweeps", "found", "flicker", "delay_s")
    return tuple(summary[f"{FAST}.{name}"] for name in figures)


def test_first_sweeps_are_granted_then_a_mover_must_be_found():
    found = [False, False, True, True, False, True]
    # The sweeps 0.3 s and more after the first.
    assert group_of(at_10_hz(map(seen, found))) == pytest.approx((1, 3, 2 / 3, 1 / 6, 0.2))


def test_order_of_rows_does_not_matter_and_recordings_are_apart():
    rows = at_10_hz(map(seen, [True, False, True, True]))
    rows += at_10_hz(map(seen, [False] * 4), "other")
    assert repr(summary_of(rows)) == repr(summary_of(rows[::-1]))
    # One that is never found counts with all its time.
    assert group_of(rows) == pytest.approx((2, 2, 0.5, 1 / 8, 0.15))


def test_mover_that_was_away_comes_into_view_anew():
    rows = at_10_hz(map(seen, [True] * 4))
    rows += [("drive", stamp + 2 * SECOND, row) for _, stamp, row in rows]
    assert group_of(rows) == (2, 2, 1.0, 0.0, 0.0)


def test_groups_are_by_speed_range_and_kind():
    def groups(**changes):
        return groups_in(summary_of(at_10_hz([seen(True, **changes)])))

    assert groups() == {FAST, "5 to 10 m/s, to 50 m", "cars, to 50 m"}
    assert groups(speed_m_s=1.0) == {SLOW, "cars, to 50 m"}
    assert groups(range_m=51.0) == set()
    assert groups(moves=False) == set()


_MOVING, _SLOW = seen(True), seen(True, 0.05, moves=False)
_STANDS, _OTHER_STANDS = (MoverRow((0, 0, 0), 0, standing=[number]) for number in (1, 2))


@pytest.mark.parametrize(
    ("rows", "after_stop_s"),
    [
        ([_MOVING, _MOVING, *[_SLOW] * 4], 0.3),
        # A parked object that was never seen to move has not stopped.
        ([_SLOW] * 5, math.nan),
        ([_MOVING] * 5, math.nan),
        # Called static at once, or called a mover again later.
        ([_MOVING, _MOVING, _STANDS, _STANDS], 0.0),
        ([_MOVING, _STANDS, _SLOW, _SLOW], 0.2),
        # Something else that stands is not the mover.
        ([_MOVING, _OTHER_STANDS], math.nan),
    ],
)
def test_time_that_an_object_is_called_a_mover_after_it_stopped(rows, after_stop_s):
    rows = at_10_hz(rows)
    # Another one that never stops does not hide it.
    for others in ([], at_10_hz([_MOVING] * 4, "other")):
        found = summary_of(others + rows)["after_stop_s"]
        assert found == pytest.approx(after_stop_s, nan_ok=True)


def test_object_that_comes_back_later_has_not_stopped():
    later = [*at_10_hz([_MOVING]), ("drive", 2 * SECOND, _STANDS)]
    assert math.isnan(summary_of(later)["after_stop_s"])


def test_static_objects_are_listed_by_number():
    ids = np.repeat([0, 1, 2, 3], 25)
    assert row_of(true_motion(ids, {1: 4.0}), said(ids == 2)).standing == [3]


def test_nothing_to_judge_is_no_number():
    summary = summary_of([("drive", 0, MoverRow((0, 0, 0), 0))])
    assert math.isnan(summary["precision"])
    assert math.isnan(summary["velocity_error_m_s"])
    assert groups_in(summary) == set()
    assert row_of(true_motion(IDS[:0], {}), said(np.zeros(0, bool))).points == (0, 0, 0)
    # Without object ids there are points, but no objects.
    truth = replace(true_motion(IDS, {1: 5.0}), object_id=None)
    row = row_of(truth, said(IDS == 1))
    assert (row.points, row.objects) == ((40, 0, 0), [])


def example():
    """The sensor turns left by 6 degrees; 40 points move at 5 m/s to its left."""
    angle = math.radians(6)
    motion = np.eye(4)
    motion[:2, :2] = [[math.cos(angle), math.sin(angle)], [-math.sin(angle), math.cos(angle)]]
    xyz = np.random.default_rng(0).uniform(5, 20, (N, 3)).astype(np.float32)
    moved = xyz + np.where((IDS == 1)[:, None], np.float32([0, 0.5, 0]), np.float32(0))
    flow = (moved @ motion[:3, :3].T).astype(np.float32) - xyz
    known = {"dynamic": IDS == 1, "object_id": IDS.astype(np.uint32)}
    return small.example_of(xyz, flow, motion=motion, **known), flow


def test_rows_of_a_run_have_movers_and_come_back_from_json():
    one, flow = example()
    tracks = np.where(IDS == 1, 3, 0).astype(np.int32)
    over_ground = said(IDS == 1, tracks=tracks, objects=(track(3, (0, 5, 0)),))
    row = scored_row(one, "online", FlowEstimate(flow, np.ones(N, bool), over_ground=over_ground))
    assert row.movers.points == (40, 0, 0)
    (item,) = row.movers.objects
    # Over ground and in the axes of the current sweep, whatever the sensor does.
    assert item.speed_m_s == pytest.approx(5.0, abs=1e-4)
    assert item.velocity_error_m_s == pytest.approx(0.0, abs=1e-4)
    assert from_json(to_json(row), ResultRow, "row").movers == row.movers
    assert scored_row(one, "mnsf", FlowEstimate(flow, np.ones(N, bool))).movers is None


def test_tables_of_movers():
    one, flow = example()

    def row(number, method, **known):
        estimate = FlowEstimate(flow, np.ones(N, bool), **known)
        stamp_ns = small.stamp(number)
        return replace(scored_row(one, method, estimate), number=number, stamp_ns=stamp_ns)

    def shown(tables):
        return {table.title.partition(",")[0]: table for table in tables if table.has_values}

    reason = {"reason_of": lambda _: Reason(Verdict.TOO_LARGE)}
    found, lost = (row(i, "online", over_ground=said(i == IDS), **reason) for i in (1, 2))
    others = row(1, "mnsf")
    summary = summarize([found, others, lost])
    tables = shown(main_tables(summary)) | shown(further_tables(summary))
    called = tables["Points called dynamic"]
    assert called.rows == [["online", "50.0", "50.0", "33.3", "0.50", "50.0"]]
    losses = tables["Mover-sweeps without detection"]
    assert (losses.header, losses.rows) == (["method", "too large"], [["online", "1"]])
    assert tables["Objects that move"].rows[-1][0] == "online: cars, to 50 m"
    assert not any("called" in title for title in shown(main_tables(summarize([others]))))


MOVED = np.array([0.0, 0.5, 0.0])  # 5 m/s to the left for a tenth of a second


@pytest.mark.parametrize(
    ("reason", "lost_by"),
    [
        (Reason(Verdict.NO_OBJECT), LostBy.NO_OBJECT),
        (Reason(Verdict.TOO_LARGE), LostBy.TOO_LARGE),
        (Reason(Verdict.NOT_SUSPECTED), LostBy.NOT_SUSPECTED),
        (Reason(Verdict.DYNAMIC), LostBy.PARTLY),
        (Reason(Verdict.REFUSED, start=MOVED + 0.5, motion=MOVED + 0.05), LostBy.GATE),
        (Reason(Verdict.REFUSED, start=MOVED + 0.1, motion=MOVED + 0.1), LostBy.FIT),
        (Reason(Verdict.REFUSED, start=MOVED + 0.5, motion=MOVED + 0.1), LostBy.FIRST_GUESS),
    ],
)
def test_lost_mover_has_what_lost_it(reason, lost_by):
    asked = []

    def reason_of(rows):
        asked.append(rows)
        return reason

    truth, none = true_motion(IDS, {1: 5.0}), said(np.zeros(N + 7, bool))
    row = mover_row(truth, none, np.arange(N) + 7, reason_of)
    (item,) = row.objects
    assert item.lost_by is lost_by
    assert item.place_m == (10.0, 0.0)
    # It is asked about the rows of the estimate.
    assert np.array_equal(asked[0], np.flatnonzero(IDS == 1) + 7)
    summary = summary_of([("drive", 0, row), ("drive", 1, row)])
    assert {k: v for k, v in summary.items() if "lost" in k} == {f"lost.{lost_by.value}": 2}
    found = mover_row(truth, said(IDS == 1), np.arange(N), reason_of)
    assert found.objects[0].lost_by is None
