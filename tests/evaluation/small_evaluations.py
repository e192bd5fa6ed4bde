# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tiny recordings with truth, and all that is needed to evaluate them."""

from __future__ import annotations

import json

import numpy as np

from mnsf_ros.core.scene_flow_estimator import MethodTraits
from mnsf_ros.evaluation.executors import run_serially
from mnsf_ros.evaluation.options import (
    EvaluatedMethod,
    EvaluationOptions,
    EvaluationTask,
    evaluated_methods,
)
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_json import to_json
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.task import TaskFailed
from mnsf_ros.evaluation.tracks import CloudRows
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.point_cloud2 import encode_columns

SESSION = SessionRecord.now(["mnsf"])
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
    source = CloudRows(np.arange(num_points), num_points, "drive")
    return Sweep(xyz(index, num_points), stamp(index), frame_id, source)


def pose(index):
    matrix = np.eye(4)
    matrix[:3, 3] = index * STEP_M
    return matrix


def write_recording(path, num_sweeps=6, *, with_truth=True, with_odometry=True, num_points=60):
    """A rosbag2 folder in the layout of docs/recordings.md."""
    with BagWriter(path) as writer:
        for index in range(num_sweeps):
            points = xyz(index, num_points)
            columns = {name: points[:, axis] for axis, name in enumerate("xyz")}
            writer.write_cloud(
                "/points", encode_columns(columns, 1, num_points), stamp(index), "lidar"
            )
            if with_truth:
                known = truth(index, num_points, valid=index + 1 < num_sweeps)
                writer.write_cloud(
                    "/truth/flow", known.encode(points), stamp(index), "lidar", is_dense=False
                )
            if with_odometry:
                writer.write_odometry("/truth/odometry", pose(index), stamp(index), "odom", "lidar")
    return path


def recording_at(path, name="drive", **topics):
    return choose_topics(inspect_recording(path), name, **topics)


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


def begun(out, recordings, methods, options, *, resume=False):
    """A run that was begun and closed again before anything was done."""
    record = RunRecord(options, methods, recordings, [SESSION])
    with RunFolder(out).opened(resume=resume) as folder:
        folder.begin(record)
        # Without any results the folder would be taken away.
        (out / "rows.jsonl").touch()
    return folder


def run(out, recordings, methods, options, *, resume=False, execute=run_serially, watch=None):
    """Runs what is left to do; returns the tasks that gave up, the events, and the folder."""
    record = RunRecord(options, methods, recordings, [SESSION])
    failed, events = {}, []
    with RunFolder(out).opened(resume=resume) as folder:
        for task, event in execute(folder.begin(record), options):
            folder.take(task, event)
            events.append(event)
            if isinstance(event, TaskFailed):
                failed[task.key] = event.reason
            if watch is not None:
                watch(task, event)
    return failed, events, folder


def old_run_record(run):
    """What early versions wrote into `run.json`, from what this one writes."""
    run, options = dict(run), dict(run["options"])
    del run["format"], run["options"], options["every"]
    settings = {**options.pop("settings")["values"], "field.kind": "network"}
    del settings["method.name"]
    chosen_by = {k: v for k, v in settings.items() if k.startswith(("crop.", "ground."))}
    methods = [method["name"] for method in run["methods"]]
    identity = {
        **options,
        "settings": {**settings, "ground.remove": False},
        "crop_and_ground": chosen_by,
        "num_points": options["num_points"] or "all",
    }
    return {**run, "identity": identity, "methods": methods}


def without_times(row):
    """A row as a dictionary without what differs from run to run."""
    values = json.loads(to_json(row))
    for name in ("time_ms", "stage_times_ms", "latency_ms"):
        del values[name]
    return values
