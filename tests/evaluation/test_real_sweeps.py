# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A few real sweeps of a 64-beam lidar with pseudo ground truth, where they are at hand."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.flow_truth import FlowTruth
from msg_utils.point_cloud2 import encode_columns

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[3] / "shared" / "data"))
FILES = sorted((DATA / "kitti_0005").glob("sweep_*.npz"))[:4]
needs_data = pytest.mark.skipif(len(FILES) < 4, reason="the recording is not at hand")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    path = tmp_path_factory.mktemp("kitti") / "kitti"
    with BagWriter(path) as writer:
        for file in FILES:
            with np.load(file) as arrays:
                _write(writer, dict(arrays))
    return path


def _write(writer, arrays):
    xyz, stamp_ns = arrays["xyz"], int(arrays["stamp_ns"])
    truth = FlowTruth(
        stamp_ns=stamp_ns,
        flow=arrays["flow"],
        # Movers are labelled only where the camera looks.
        valid=arrays["flow_valid"] & arrays["label_valid"],
        dynamic=arrays["is_dynamic"],
        ground=arrays["is_ground"],
        class_id=np.where(arrays["box_track_id"] >= 0, 6, 0).astype(np.uint8),
    )
    columns = {name: xyz[:, axis] for axis, name in enumerate("xyz")}
    writer.write_cloud("/points", encode_columns(columns, 1, len(xyz)), stamp_ns, "lidar")
    writer.write_cloud("/truth/flow", truth.encode(xyz), stamp_ns, "lidar", is_dense=False)
    writer.write_odometry("/truth/odometry", arrays["pose"], stamp_ns, "odom", "lidar")


@needs_data
def test_odometry_explains_what_stands_still_and_nothing_else(bag):
    task = small.task_at(bag, "ego", "kitti")
    *rows, findings = run_task(task, small.options(num_points=8192))
    assert not findings.counts
    assert [row.failure for row in rows] == [None, None]
    summary = summarize(rows).loc["ego"]
    assert summary["errors.static.epe_m"] < 0.02
    assert summary["errors.static.acc5"] > 0.95
    assert summary["errors.dynamic.epe_m"] > 0.1
    assert summary["bucketed.CAR.dynamic"] == pytest.approx(1.0, abs=0.1)
    # The sensor moves a third of a metre, about as much as points are apart.
    assert summary["consistency.nearest_m"] < 0.8 * summary["consistency.zero_nearest_m"]
