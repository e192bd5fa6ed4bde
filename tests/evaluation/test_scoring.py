# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import math
from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.argoverse_metrics import over_all_points, range_sums
from mnsf_ros.evaluation.scoring import (
    failed_row,
    scored_row,
    true_motion,
)

# The sensor moves 1 m forward; one point moves 0.2 m to the left by itself.
XYZ = np.array([[5, 0, 0], [15, 0, 0], [30, 0, 0], [9, 0, 0]], np.float32)
FLOW = np.array([[-1, 0, 0], [-1, 0, 0], [-1, 0, 0], [-1, 0.2, 0]], np.float32)
DYNAMIC = np.array([False, False, False, True])
MOTION = np.eye(4)
MOTION[0, 3] = -1.0


CLASSES = np.array([3, 3, 6, 6], np.uint8)


def make_example(*, motion=MOTION, **known):
    known = {"dynamic": DYNAMIC, "class_id": CLASSES, **known}
    return small.example_of(XYZ, FLOW, motion=motion, **known)


def estimate(flow, kept=None):
    flow = np.asarray(flow, dtype=np.float32)
    return FlowEstimate(flow, np.ones(len(flow), bool) if kept is None else kept)


def with_kept(example, kept, *, of_next=True):
    triplet = example.triplet
    changes = {name: replace(getattr(triplet, name), kept=kept) for name in ("current", "next")}
    if not of_next:
        del changes["next"]
    return replace(example, triplet=replace(triplet, **changes))


def test_perfect_flow():
    row = scored_row(make_example(), "mnsf", estimate(FLOW), 12.0)
    assert (row.recording, row.number, row.stamp_ns) == ("drive", 1, small.stamp(1))
    assert (row.method, row.num_points, row.time_ms, row.failure) == ("mnsf", 4, 12.0, None)
    assert {name: errors.num_points for name, errors in row.errors.items()} == {
        "all": 4,
        "dynamic": 1,
        "static": 3,
    }
    assert all(errors.epe_m == 0 for errors in row.errors.values())
    assert row.consistency == {"nearest_m": 0.0, "zero_nearest_m": pytest.approx(1.005, abs=0.01)}


@pytest.mark.parametrize("kept", [[True] * 4, [True, False, True, False]])
def test_self_consistency_is_that_of_the_same_points_whatever_a_method_was_fitted_to(kept):
    # Only the first and the last point are scored; the others are far off.
    flow = FLOW + np.array([[0, 0, 0.1], [0, 0, 7], [0, 0, 7], [0, 0, 0.3]], np.float32)
    example = with_kept(make_example(), np.array([True, False, False, True]), of_next=False)
    row = scored_row(example, "mnsf", estimate(flow, np.array(kept)))
    assert row.consistency["nearest_m"] == pytest.approx(0.2)


def test_errors_fall_into_bands_and_classes():
    flow = FLOW + np.array([[0.1, 0, 0], [0.2, 0, 0], [0.4, 0, 0], [0, -0.2, 0]], np.float32)
    row = scored_row(make_example(), "ego", estimate(flow))
    epe = {limit: errors.epe_m for limit, errors in row.by_range.items()}
    assert epe == pytest.approx({"10": 0.15, "20": 0.2, "35": 0.4}, rel=1e-5)
    # The mover has 0.2 m in 0.1 s: 2 m/s, which is the lower limit of the next band.
    epe = {limit: errors.epe_m for limit, errors in row.by_speed.items()}
    assert list(epe) == ["0.5", "5"]
    assert epe["5"] == pytest.approx(0.2)
    errors = over_all_points([row.sums])
    assert errors["three_way.foreground static"] == pytest.approx(0.4, rel=1e-5)
    assert errors["bucketed.CAR.dynamic"] == pytest.approx(1.0, rel=1e-5)
    assert errors["bucketed.BACKGROUND.static"] == pytest.approx(0.15, rel=1e-5)
    ranges = {name: one for name, one in errors.items() if name.startswith("range_wise")}
    assert ranges == pytest.approx(
        {
            **dict.fromkeys(("range_wise.static 0-35", "range_wise.static mean"), 0.7 / 3),
            **dict.fromkeys(("range_wise.dynamic 0-35", "range_wise.dynamic mean"), 0.2),
        },
        rel=1e-5,
    )


def test_range_wise_errors_have_the_edges_of_opensceneflow():
    errors, motion = np.arange(8.0), np.array([0, 0, 0.139, 0.14, 0, 0, 1, 0.0])
    distances = np.array([34.9, 35, 49.9, 50, 75, 99.9, 100, 1e9])
    found = over_all_points([range_sums(errors, motion, distances)])
    assert {name: one for name, one in found.items() if name.startswith("range_wise")} == {
        "range_wise.static 0-35": 0.0,
        "range_wise.static 35-50": 1.5,
        "range_wise.static 75-100": 4.5,
        "range_wise.static 100-inf": 7.0,
        "range_wise.static mean": 3.25,
        "range_wise.dynamic 50-75": 3.0,
        "range_wise.dynamic 100-inf": 6.0,
        "range_wise.dynamic mean": 4.5,
    }


def test_motion_counts_per_100_ms_whatever_the_interval():
    # The same flow within 50 ms: 4 m/s, 0.4 m and an error of 0.4 m in 100 ms.
    flow = FLOW.copy()
    flow[3, 1] = 0.0
    row = scored_row(make_example(interval_ms=50), "ego", estimate(flow))
    (moving,) = (sums for name, sums in row.sums.items() if name in ("CAR/9", "CAR/10"))
    assert moving == pytest.approx([1.0, 0.4, 0.4], rel=1e-5)
    assert list(row.by_speed) == ["0.5", "5"]


def test_wrong_odometry_does_not_change_who_moves_how_fast():
    """Ego motion is that of the truth where enough points are static."""
    xyz = np.random.default_rng(0).uniform(-20, 20, (50, 3)).astype(np.float32)
    dynamic = np.arange(50) < 10
    flow = np.tile(np.float32([-1, 0, 0]), (50, 1))
    flow[dynamic, 1] += 0.2
    jumped = MOTION.copy()
    jumped[0, 3] = 50.0
    right, wrong = (
        scored_row(small.example_of(xyz, flow, motion=motion, dynamic=dynamic), "x", estimate(flow))
        for motion in (MOTION, jumped)
    )
    assert right.by_speed == wrong.by_speed
    assert right.by_speed.keys() == {"0.5", "5"}
    assert right.sums == wrong.sums


def test_in_a_bend_each_moment_of_a_sweep_has_its_own_ego_motion():
    """The sensor turns by 0.02 rad more at the end of the sweep: all points are static."""
    random, number = np.random.default_rng(0), 2000
    times_s = np.linspace(0, 0.1, number).astype(np.float32)
    angles, ranges, turns = 20 * np.pi * times_s, random.uniform(10, 40, number), 0.2 * times_s
    x, y, z = ranges * np.cos(angles), ranges * np.sin(angles), random.uniform(-1, 1, number)
    turned = (x * np.cos(turns) + y * np.sin(turns), y * np.cos(turns) - x * np.sin(turns), z)
    xyz, flow = (np.stack(part, axis=1).astype(np.float32) for part in ((x, y, z), turned))
    flow -= xyz
    example = small.example_of(xyz, flow, motion=np.eye(4), times_s=times_s)
    known, own_m = true_motion(example, example.truth, np.arange(number))
    # With one motion for all it would be 2 m/s.
    assert np.linalg.norm(known.velocity, axis=1).max() < 0.5
    assert own_m.max() < 0.05


def test_static_points_in_one_place_do_not_overrule_odometry():
    """Within half a metre, a centimetre of noise is a turn: movers far from them would race."""
    random = np.random.default_rng(0)
    static = np.array([40, 0, 0]) + random.uniform(-0.25, 0.25, (20, 3))
    movers = np.array([[-40, 0, 0], [-40, 20, 0], [-30, -30, 0], [0, 40, 0]])
    xyz = np.concatenate([static, movers]).astype(np.float32)
    dynamic = np.arange(24) >= 20
    flow = np.tile(np.float32([-1, 0, 0]), (24, 1))
    flow[:20] += random.normal(0, 0.01, (20, 3)).astype(np.float32)
    flow[dynamic, 1] += 0.1
    example = small.example_of(xyz, flow, motion=MOTION, dynamic=dynamic)
    row = scored_row(example, "x", estimate(flow))
    # By odometry the movers go 1 m/s.
    points = {limit: errors.num_points for limit, errors in row.by_speed.items()}
    assert points == {"0.5": 20, "2": 4}


def test_points_that_are_not_valid_are_not_scored_nor_failures():
    flow = FLOW.copy()
    flow[3] = 9.0
    row = scored_row(make_example(valid=~DYNAMIC), "x", estimate(flow))
    assert (row.errors["all"].epe_m, row.errors["all"].num_points) == (0, 3)
    assert math.isnan(row.errors["dynamic"].epe_m)
    nothing = make_example(valid=np.zeros(4, bool), motion=None)
    row = scored_row(nothing, "x", estimate(FLOW))
    assert (row.errors["all"].num_points, row.by_range, row.sums) == (0, {}, {})
    row = failed_row(nothing, "x", "no points")
    assert row.failure == "no points"
    assert (row.errors, math.isnan(row.time_ms)) == ({}, True)


@pytest.mark.parametrize("far", [50.0, np.nan])
def test_only_kept_points_are_scored(far):
    """The others may have a flow, a wrong one even, or none."""
    kept = np.array([True, True, False, True])
    flow = np.where(kept[:, None], FLOW, np.float32(far))
    row = scored_row(with_kept(make_example(), kept), "x", estimate(flow, kept))
    assert row.num_points == row.errors["all"].num_points == 3
    assert row.errors["all"].epe_m == row.consistency["nearest_m"] == 0


@pytest.mark.parametrize(
    ("flow", "text"),
    [
        (FLOW[:3], "flow of shape"),
        (FLOW[:, :2], "flow of shape"),
        (np.where(DYNAMIC[:, None], np.nan, FLOW), "flow of 1 of 4 points is not finite"),
    ],
)
def test_estimate_that_does_not_fit_is_refused(flow, text):
    with pytest.raises(EvaluationError, match=text):
        scored_row(make_example(), "x", estimate(flow))
