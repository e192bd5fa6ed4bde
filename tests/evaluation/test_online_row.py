# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The row `online` of an evaluation is what the live node gives."""

import time

import numpy as np
import pytest
import small_evaluations as small

from mnsf_ros.evaluation import task as task_module
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.tracks import recorded_sweeps
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.settings import Settings
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.stream.pipeline import StreamPipeline


@pytest.fixture(scope="module")
def street(tmp_path_factory):
    """A street with ground."""
    path = tmp_path_factory.mktemp("recordings") / "street"
    write_recording(SimulationSettings(duration_s=0.6, num_beams=32, num_columns=720), path)
    return small.recording_at(path, "street")


def live_flows(street, settings):
    """Stamp to the flow that the pipeline of the node hands out."""
    flows, failures = {}, []

    def keep(job, estimate):
        flows[job.triplet.current.stamp_ns] = estimate.flow

    pipeline = StreamPipeline(settings, keep, lambda job, error: failures.append(error))
    with BagReader(street.path) as reader:
        for sweep in recorded_sweeps(reader, street.points, "street", Settings(), Findings()):
            pipeline.add_sweep(sweep, time.monotonic_ns())
            while pipeline.load:
                time.sleep(0.005)
    assert pipeline.close(300.0)
    assert not failures
    return flows


def test_online_row_is_what_the_robot_gets(street, monkeypatch):
    flows, score = {}, task_module.scored_row

    def keeping(example, method, estimate, time_ms):
        flows[example.triplet.current.stamp_ns] = estimate.flow
        return score(example, method, estimate, time_ms)

    monkeypatch.setattr(task_module, "scored_row", keeping)
    options = EvaluationOptions(preset("online"))
    (method,) = small.methods_of(["online"], options)
    events = task_module.run_task(EvaluationTask(street, method), options)
    rows = [event for event in events if isinstance(event, ResultRow)]
    live = live_flows(street, options.settings)
    assert len(rows) == 4
    assert flows.keys() == live.keys()
    for stamp_ns, flow in flows.items():
        assert np.array_equal(flow, live[stamp_ns])
    # Registered without its ground a street is seen several centimetres off.
    assert np.mean([row.errors["static"].epe_m for row in rows]) < 0.025
