# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
import small_evaluations as small
from bag_messages import cloud_message
from box_street import pose

from mnsf_ros.evaluation.examples import ExampleBuilder, kept_points, read_examples
from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.truth_track import TruthCloud, TruthTrack
from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.methods import make_method
from mnsf_ros.settings import Settings


def truth_cloud(index, truth=None):
    encoded = (truth or small.truth(index)).encode(small.xyz(index))
    message = cloud_message(encoded, small.stamp(index), "lidar", is_dense=False)
    return TruthCloud(small.stamp(index), message)


def poses_of(indices):
    return PoseTrack(
        StampedPose(small.stamp(index), small.pose(index), "lidar") for index in indices
    )


def options_of(**values):
    return EvaluationOptions(Settings(), **values)


def examples_of(sweeps, *, truth_of=None, options=None, findings=None, **arguments):
    findings = findings or Findings()
    truth = None
    if truth_of is not None:
        truth = TruthTrack(map(truth_cloud, truth_of), findings, "drive")
    builder = ExampleBuilder(options or options_of(), findings, truth=truth, **arguments)
    return builder.examples(sweeps)


def triplets_of(examples):
    """Indices of the sweeps of each example."""

    def index(sweep):
        return (sweep.stamp_ns - small.FIRST_NS) // small.STEP_NS

    return [
        tuple(map(index, (e.triplet.previous, e.triplet.current, e.triplet.next))) for e in examples
    ]


@pytest.mark.parametrize(
    ("num_sweeps", "expected"), [(3, [(0, 1, 2), (1, 2, 3), (2, 3, 4)]), (5, [(2, 3, 4)])]
)
def test_each_sweep_with_enough_neighbours_makes_an_example(num_sweeps, expected):
    sweeps = map(small.sweep, range(5))
    examples = list(examples_of(sweeps, num_sweeps=num_sweeps, poses=poses_of([0, 1, 2, 3, 4])))
    assert triplets_of(examples) == expected
    assert [example.number for example in examples] == [current for _, current, _ in expected]
    # Earlier ones come nearest first, and there are two of them at most.
    last = examples[-1].triplet
    assert [sweep.stamp_ns for sweep in last.earlier] == [small.stamp(1), small.stamp(0)]
    for index, sweep in enumerate((*reversed(last.before), last.current, last.next)):
        assert np.array_equal(sweep.odometry, small.pose(index))
    motion = np.eye(4)
    motion[0, 3] = -0.5
    assert np.allclose(last.next_from_current, motion)


@pytest.mark.parametrize("num_points", [0, 20])
def test_methods_get_whole_sweeps_and_the_points_that_count(num_points):
    options = options_of(num_points=num_points, seed=1)
    for example in examples_of(map(small.sweep, range(4)), truth_of=range(4), options=options):
        triplet, expected = example.triplet, small.truth(example.number)
        for sweep in (*triplet.before, triplet.current, triplet.next):
            assert len(sweep) == 60
            assert not sweep.kept[expected.ground].any()
            assert np.count_nonzero(sweep.kept) == (num_points or 54)
        assert np.array_equal(example.scored, triplet.current.kept)
        assert np.array_equal(example.truth.flow, expected.flow)
        assert np.array_equal(example.truth.class_id, expected.class_id)


def test_no_triplet_across_a_place_where_sweeps_may_be_missing():
    findings = Findings()
    sweeps = [*map(small.sweep, range(4)), None, *map(small.sweep, range(4, 8))]
    examples = list(examples_of(sweeps, findings=findings))
    assert triplets_of(examples) == [(0, 1, 2), (1, 2, 3), (4, 5, 6), (5, 6, 7)]
    assert all(not example.triplet.earlier for example in examples[2:3])
    assert findings.counts == {Event.INTERRUPTIONS: 1}


def test_gap_in_time_duplicate_and_other_frame_are_counted():
    findings = Findings()
    sweeps = [*map(small.sweep, range(3)), small.sweep(2), *map(small.sweep, range(20, 23))]
    sweeps += [small.sweep(index, frame_id="roof") for index in range(23, 26)]
    examples = list(examples_of(sweeps, findings=findings))
    assert triplets_of(examples) == [(0, 1, 2), (20, 21, 22), (23, 24, 25)]
    assert findings.counts == {
        Event.DUPLICATE: 1,
        Event.GAP: 1,
        Event.FRAME_CHANGED: 1,
    }


def test_rows_count_in_the_cloud_also_where_points_were_not_finite():
    sweep = small.sweep(1, 60)
    finite = np.delete(np.arange(60), [0, 7])
    source = replace(sweep.source, measured=np.isin(np.arange(60), finite))
    holed = type(sweep)(sweep.xyz[finite], sweep.stamp_ns, sweep.frame_id, source)
    sweeps = [small.sweep(0), holed, small.sweep(2)]
    (example,) = examples_of(sweeps, truth_of=range(3))
    assert np.array_equal(example.triplet.current.source.rows, finite)
    assert np.array_equal(example.truth.flow, small.truth(1).flow[finite])
    assert np.array_equal(example.scored, finite % 10 != 1)


def test_truth_is_not_used_across_a_sweep_that_is_missing():
    # Truth of sweep 3 leads to sweep 4, which is lost: no triplet may take 5 for it.
    findings = Findings()
    sweeps = [small.sweep(index) for index in range(9) if index != 4]
    examples = list(examples_of(sweeps, truth_of=range(9), findings=findings))
    assert triplets_of(examples) == [(0, 1, 2), (1, 2, 3), (5, 6, 7), (6, 7, 8)]
    assert findings.counts == {
        Event.TRUTH_WITHOUT_SWEEP: 1,
        Event.INTERRUPTIONS: 1,
    }


def test_odometry_that_is_missing_or_of_another_frame_is_counted():
    findings = Findings()
    poses = PoseTrack([StampedPose(small.stamp(1), small.pose(1), "base_link")])
    (example,) = examples_of(map(small.sweep, range(3)), poses=poses, findings=findings)
    assert example.triplet.next_from_current is None
    assert findings.counts == {Event.SWEEPS_WITHOUT_POSE: 2, Event.FRAMES_DIFFER: 1}


def test_nothing_is_kept_of_a_recording_of_any_length():
    alive = weakref.WeakSet()
    most = 0

    def sweeps():
        nonlocal most
        for index in range(400):
            sweep = small.sweep(index)
            alive.add(sweep)
            yield sweep
            del sweep
            most = max(most, len(alive))

    count = 0
    for example in examples_of(sweeps(), truth_of=range(400)):
        count += 1
        alive.add(example)
        alive.add(example.triplet.current)
        del example
    gc.collect()
    assert count == 398
    # Five sweeps as they were selected, the newest as it was read, and a few on their way.
    assert most < 15


def test_truth_that_no_sweep_fits_costs_no_example():
    """As of a recording whose truth has stamps of its own: it goes as one without truth."""
    findings = Findings()
    sweeps = [small.sweep(index) for index in (0, 2, 4, 6)]
    examples = list(examples_of(sweeps, truth_of=(1, 3, 5, 7), findings=findings))
    assert triplets_of(examples) == [(0, 2, 4), (2, 4, 6)]
    assert [example.truth for example in examples] == [None, None]
    assert findings.counts == {
        Event.TRUTH_WITHOUT_SWEEP: 3,
        Event.SWEEPS_WITHOUT_TRUTH: 4,
    }


def test_ego_motion_by_odometry_is_that_of_the_recording(tmp_path, monkeypatch):
    """Odometry tells of a curve that the points know nothing of: they cannot have told it."""
    monkeypatch.setattr(small, "pose", lambda index: pose(0.4 * index, yaw_deg=3.0 * index))
    recording = small.recording_at(small.write_recording(tmp_path / "drive", 6))
    options = small.options({"ego_motion.source": "odometry"})
    told, found = (make_method(method, options.settings) for method in ("ego", "ego-estimated"))
    examples = list(read_examples(recording, options, Findings()))
    assert len(examples) == 4
    for example in examples:
        flow, expected = (method.estimate(example.triplet).flow for method in (found, told))
        assert np.allclose(flow, expected, rtol=0, atol=1e-3)


NEAR = {"crop.min_range_m": 1.0, "crop.max_range_m": 10.0, "crop.max_height_m": 3.0}


def kept(xyz, changes, true_ground=None, stamp_ns=1, **values):
    options = EvaluationOptions(Settings().changed(changes), **values)
    return kept_points(np.asarray(xyz, np.float32), stamp_ns, true_ground, options)


def test_points_count_within_the_crop_and_without_ground():
    xyz = [[0.5, 0, 0], [5, 0, 0], [11, 0, 0], [5, 0, 4], [6, 0, 0]]
    ground = np.array([False, True, False, False, False])
    assert np.flatnonzero(kept(xyz, NEAR | {"ground.remove": False}, ground)).tolist() == [1, 4]
    assert np.flatnonzero(kept(xyz, NEAR, ground)).tolist() == [4]


def test_ground_is_found_as_the_node_does_without_truth_or_when_asked():
    xyz = [[x, y, 0.0] for x in range(2, 7) for y in range(-3, 4)] + [[4.0, 0.0, 1.5]]
    lying = np.zeros(len(xyz), dtype=bool)
    expected = [False] * (len(xyz) - 1) + [True]
    assert kept(xyz, NEAR).tolist() == expected
    assert kept(xyz, NEAR, lying, ground="settings").tolist() == expected


def test_random_points_are_the_same_for_a_seed_and_a_stamp():
    xyz = np.random.default_rng(0).uniform(-1, 1, (1000, 3))
    wide = {"crop.min_range_m": 0.0, "ground.remove": False}
    rows, again, other_stamp, other_seed = (
        np.flatnonzero(kept(xyz, wide, stamp_ns=stamp_ns, num_points=100, seed=seed))
        for stamp_ns, seed in ((17, 3), (17, 3), (18, 3), (17, 4))
    )
    assert np.array_equal(rows, again)
    assert not np.array_equal(rows, other_stamp)
    assert not np.array_equal(rows, other_seed)
    # From all of the sweep, not from a part of it.
    assert (len(rows), rows.min() < 100, rows.max() >= 900) == (100, True, True)
    assert kept(xyz[:5], wide, num_points=6).all()
