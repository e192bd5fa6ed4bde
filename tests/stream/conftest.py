# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of moving boxes, quick settings, and waiting for another thread."""

import time

import pytest
from moving_boxes import MOTION, surfaces
from pipelines import PATIENCE_S, Recorder

from mnsf_ros.settings import Settings
from mnsf_ros.stream.pipeline import StreamPipeline
from mnsf_ros.sweeps.sweep import Sweep


@pytest.fixture(scope="session")
def make_sweep():
    """Sweeps by their number: the same points of the boxes' surfaces, moved a little further."""

    def make(index, *, num_points=400, frame_id="lidar"):
        xyz = surfaces(index, num_points)
        return Sweep(xyz, stamp_ns=10**9 + round(index * 10**8), frame_id=frame_id)

    return make


@pytest.fixture(scope="session")
def motion():
    return MOTION


@pytest.fixture(scope="session")
def quick_settings():
    """The default but for ground, of which the sweeps have none: an estimate of some 20 ms."""
    return Settings().changed(
        {"ground.remove": False, "compute.num_threads": 1, "compute.device": "cpu"}
    )


@pytest.fixture(scope="session")
def wait_until():
    """Waits until a condition is true that another thread makes true."""

    def wait(condition):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up, f"nothing happened within {PATIENCE_S} s"
            time.sleep(0.002)

    return wait


@pytest.fixture
def recorder():
    return Recorder()


@pytest.fixture
def make_pipeline(recorder):
    """Pipelines that hand out to the recorder, and are closed at the end."""
    pipelines = []

    def make(settings):
        pipelines.append(StreamPipeline(settings, recorder.on_estimate, recorder.on_failure))
        return pipelines[-1]

    yield make
    recorder.gate.let_go()
    for pipeline in pipelines:
        assert pipeline.close(PATIENCE_S)
