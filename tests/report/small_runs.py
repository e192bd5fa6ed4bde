# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rows and the record of a small run, without any file."""

import numpy as np

from mnsf_ros.core.scene_flow_estimator import MethodTraits
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.pictures import Picture, picture_file, worst_name
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.scoring import DROPPED, ResultRow
from mnsf_ros.presets import preset
from mnsf_ros.report.page import write_report

METHODS = ["mnsf", "fnsf", "zero"]
REFERENCES = ("zero", "ego")
NOTHING = {"errors": {}, "by_range": {}, "by_speed": {}, "consistency": {}}


def errors(epe_m, num_points=10):
    return FlowErrors(epe_m, 0.5, 0.75, 0.25, 0.125, num_points)


def row(number, method, epe_m, **values):
    values = {
        "time_ms": 100.0,
        "stage_times_ms": {"prepare": 10.0, "forward": 60.0},
        "errors": {name: errors(epe_m) for name in ("all", "dynamic", "static")},
        "by_range": {"inf": errors(3 * epe_m), "10": errors(epe_m), "80": errors(2 * epe_m)},
        "by_speed": {"0.5": errors(epe_m), "2": errors(epe_m)},
        "consistency": {"nearest_m": 0.25, "zero_nearest_m": 0.5},
        **values,
    }
    recording, stamp_ns = values.pop("recording", "street"), values.pop("stamp_ns", 10**9 * number)
    return ResultRow(recording, number, stamp_ns, method, 10, **values)


def failed(number, method, text, **values):
    return row(number, method, 0.0, **NOTHING, time_ms=np.nan, failure=text, **values)


def dropped(number, method):
    return row(number, method, 0.0, **NOTHING, time_ms=np.nan, failure=DROPPED)


def rows():
    found = [row(n, m, 0.1 * n + 0.01 * k) for n in (1, 2, 3) for k, m in enumerate(METHODS)]
    return [*found, dropped(4, "mnsf")]


def rows_without_truth():
    return [
        row(n, "mnsf", 0.0, **NOTHING | {"consistency": {"nearest_m": n / 10}}) for n in (1, 2, 3)
    ]


def recording(name="street", truth="/truth/flow", **values):
    place = {"path": f"/nowhere/{name}", "points": "/points", "odometry": None, "num_sweeps": 5}
    known = {"damages": [], "fingerprint": {}, **values}
    return EvaluatedRecording(name=name, truth=truth, **place, **known)


def session(values=None):
    return {
        "started": "2024-05-23T08:00:00+00:00",
        "command": "mnsf evaluate street",
        "machine": "box, fast, 2 cores",
        "system": "Linux",
        "mnsf_ros": "1.0",
        "git commit": "abc123",
        "torch": "2.0",
        **(values or {}),
    }


def run_record(methods=METHODS, truth="/truth/flow", **values):
    known = {
        "options": EvaluationOptions(preset("paper"), num_points=2048, seed=7),
        "methods": [
            EvaluatedMethod(one, MethodTraits(is_reference=one in REFERENCES)) for one in methods
        ],
        "recordings": [recording(truth=truth)],
        "sessions": [session()],
    }
    return RunRecord(**known | values)


def kept(number=3, *, methods=METHODS[:2]):
    """Pictures as a run keeps them for its report."""
    return [Picture(picture_file("street", one, worst_name(number)), b"PNG") for one in methods]


def write_run_report(path, results, pictures=()):
    folder = RunFolder(path)
    for picture in pictures:
        folder.take(picture)
    return write_report(folder, results)
