# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tiny recordings with truth, and all that is needed to evaluate them."""

import json
from dataclasses import replace

import numpy as np

from mnsf_ros.core.scene_flow_estimator import MethodTraits
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.options import (
    EvaluatedMethod,
    EvaluationOptions,
    EvaluationTask,
    evaluated_methods,
)
from mnsf_ros.evaluation.parallel import run_serially
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.run_folder import RunFolder, to_json
from mnsf_ros.evaluation.run_record import RunRecord, session_now
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import CloudSource
from msg_utils.point_cloud2 import encode_columns
from msg_utils.point_times import PointTimes

SESSION = session_now(["mnsf"])
FIRST_NS = 1_700_000_000_000_000_000
STEP_NS = 100_000_000
STEP_M = np.array([0.5, 0.0, 0.0], dtype=np.float32)

# The smallest of networks: what is tested is what happens around them.
TINY = {
    "field.num_hidden_layers": 1,
    "field.hidden_width": 4,
    "fusion.num_hidden_layers": 1,
    "fusion.hidden_width": 4,
    "optimization.max_iterations": 3,
    "fusion.max_iterations": 3,
    "distance.kind": "tree",
}


def stamp(index):
    return FIRST_NS + index * STEP_NS


def xyz(index, num_points=60):
    """Points 5 to 20 m ahead; point i of all sweeps is the same one, 0.5 m nearer each time."""
    random = np.random.default_rng(7)
    points = random.uniform((5, -8, -1), (20, 8, 2), (num_points, 3)).astype(np.float32)
    return points - index * STEP_M


def truth(index, num_points=60, *, valid=True):
    """Every fifth point moves 0.1 m to the left, every tenth is ground, the rest stands still."""
    number = np.arange(num_points)
    dynamic = number % 5 == 0
    flow = np.tile(-STEP_M, (num_points, 1))
    flow[dynamic, 1] += 0.1
    return FlowTruth(
        stamp_ns=stamp(index),
        flow=flow.astype(np.float32),
        valid=np.full(num_points, valid),
        dynamic=dynamic,
        ground=number % 10 == 1,
        class_id=np.where(dynamic, 6, 3).astype(np.uint8),
    )


def sweep(index, num_points=60, frame_id="lidar"):
    """A sweep as the recording gives it."""
    measured = np.ones(num_points, bool)
    source = CloudSource(None, measured, PointTimes(None), recording="drive")
    return Sweep(xyz(index, num_points), stamp(index), frame_id, source)


def example_of(xyz, flow, *, motion=None, interval_ms=100, times_s=None, **known):
    """An example whose truth has some columns; by default all points are those of a static car."""
    stamps_ns = (stamp(0), stamp(1), stamp(1) + interval_ms * 1_000_000)
    previous, current, following = map(Sweep, (xyz, xyz, xyz + flow), stamps_ns)
    none = np.zeros(len(xyz), bool)
    columns = {"valid": ~none, "dynamic": none, "ground": none, **known}
    columns.setdefault("class_id", np.full(len(xyz), 6, np.uint8))
    current = replace(current, times_s=times_s)
    triplet = SweepTriplet(previous, current, following, next_from_current=motion)
    return Example("drive", 1, triplet, FlowTruth(stamp_ns=stamp(1), flow=flow, **columns))


def pose(index):
    matrix = np.eye(4)
    matrix[:3, 3] = index * STEP_M
    return matrix


def write_recording(path, num_sweeps=6, *, with_truth=True, with_odometry=True, num_points=60):
    """A rosbag2 folder in the layout of docs/recordings.md; a list of indices leaves out others."""
    indices = range(num_sweeps) if isinstance(num_sweeps, int) else num_sweeps
    with BagWriter(path) as writer:
        for index in indices:
            points = xyz(index, num_points)
            columns = {name: points[:, axis] for axis, name in enumerate("xyz")}
            cloud = encode_columns(columns, 1, num_points)
            writer.write_cloud("/points", cloud, stamp(index), "lidar")
            if with_truth:
                known = truth(index, num_points, valid=index != indices[-1]).encode(points)
                writer.write_cloud("/truth/flow", known, stamp(index), "lidar", is_dense=False)
            if with_odometry:
                writer.write_odometry("/truth/odometry", pose(index), stamp(index), "odom", "lidar")
    return path


def recording_at(path, name="drive", **topics):
    return choose_topics(path, name, **topics)


def task_at(path, method="ego", name="drive"):
    (described,) = methods_of([method])
    return EvaluationTask(recording_at(path, name), described)


def methods_of(names, evaluation=None):
    """Methods as a run has them; of one that does not exist nothing is known."""
    known = [name for name in names if name not in ("nothing", "mnfs")]
    found = {one.name: one for one in evaluated_methods(known, evaluation or options())}
    return [found.get(name, EvaluatedMethod(name, MethodTraits())) for name in names]


def options(changes=None, **values):
    return EvaluationOptions(preset("paper").changed({**TINY, **(changes or {})}), **values)


def run(out, recordings, methods, options, *, resume=False, watch=lambda task, event: None):
    """Runs what is left to do; returns the events and the folder."""
    record, events = RunRecord(options, methods, recordings, [SESSION]), []
    folder = RunFolder(out)
    for task, event in run_serially(folder.begin(record, resume=resume), options):
        folder.take(event)
        events.append(event)
        watch(task, event)
    return events, folder


def without_times(row):
    """A row as a dictionary without what differs from run to run."""
    values = json.loads(to_json(row))
    for name in ("time_ms", "stage_times_ms", "latency_ms"):
        del values[name]
    return values
