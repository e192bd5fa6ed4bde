# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rows and the record of a small run, without any file."""

from __future__ import annotations

import numpy as np

from mnsf_ros.core.scene_flow_estimator import MethodTraits
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import DROPPED, ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import MachineRecord, RunRecord, SessionRecord
from mnsf_ros.evaluation.shown_flows import ShownFlow
from mnsf_ros.presets import preset
from mnsf_ros.report.page import write_report
from mnsf_ros.report.run_tables import tables_of

METHODS = ["mnsf", "fnsf", "zero"]


def errors(epe_m, num_points=10):
    return FlowErrors(epe_m, 0.5, 0.75, 0.25, 0.125, num_points)


def row(number, method, epe_m, **values):
    values = {
        "time_ms": 100.0,
        "stage_times_ms": {"prepare": 10.0, "forward": 60.0},
        "errors": {name: errors(epe_m) for name in ("all", "dynamic", "static")},
        "by_range": {"10": errors(epe_m), "20": errors(2 * epe_m), "inf": errors(3 * epe_m)},
        "by_speed": {"0.5": errors(epe_m), "2": errors(epe_m)},
        "consistency": {"nearest_m": 0.25, "zero_nearest_m": 0.5},
        **values,
    }
    return ResultRow("street", number, 10**9 * number, method, 10, **values)


def rows():
    found = [row(n, m, 0.1 * n + 0.01 * k) for n in (1, 2, 3) for k, m in enumerate(METHODS)]
    dropped = row(4, "mnsf", 0.0, errors={}, by_range={}, by_speed={}, failure=DROPPED)
    return [*found, dropped]


def rows_without_truth():
    return [
        row(n, "mnsf", 0.0, errors={}, by_range={}, by_speed={}, consistency={"nearest_m": 0.1 * n})
        for n in (1, 2, 3)
    ]


def run_record(methods=METHODS, truth="/truth/flow"):
    options = EvaluationOptions(preset("paper"), num_points=2048, seed=7)
    described = [
        EvaluatedMethod(name, MethodTraits(is_reference=name in ("zero", "ego")))
        for name in methods
    ]
    recording = EvaluatedRecording(
        name="street",
        path="/nowhere/street",
        points="/points",
        truth=truth,
        odometry=None,
        num_sweeps=5,
        has_checksums=True,
        damages=[],
        fingerprint={},
    )
    session = SessionRecord(
        started="2024-05-23T08:00:00+00:00",
        command=["mnsf", "evaluate", "street"],
        versions={"mnsf_ros": "1.0", "torch": "2.0"},
        machine=MachineRecord("box", "Linux", "fast", 2, None),
        git_commit="abc123",
    )
    return RunRecord(options, described, [recording], [session])


def kept(number=3, *, methods=METHODS[:2], with_truth=True, mover=None):
    """Flows as a run keeps them for its report."""
    random = np.random.default_rng(number)
    xyz = random.uniform(-20, 20, (300, 3)).astype(np.float32)
    truth = np.tile(np.float32([-0.8, 0, 0]), (300, 1))
    flow = truth + random.normal(0, 0.1, truth.shape).astype(np.float32)
    errors_m = np.linalg.norm(flow - truth, axis=1)
    known = {"truth": truth if with_truth else None, "mover": mover}
    return [ShownFlow("street", one, number, xyz, flow, errors_m, **known) for one in methods]


def write_run_report(path, results, kept_flows=()):
    folder = RunFolder(path)
    for flow in kept_flows:
        folder.flows.add(flow, 9)
    return write_report(folder, results, tables_of(results))
