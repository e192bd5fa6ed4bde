# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Both ends of a pipeline: gates that hold it up, and what it hands out."""

import threading

from mnsf_ros.core.scene_flow_estimator import never
from mnsf_ros.errors import CancelledError
from mnsf_ros.stream.pipeline import TRIPLET_ENDS

# Only a failing test waits that long.
PATIENCE_S = 300.0


class Gate:
    """Open unless it is held; tells whether somebody waits at it."""

    def __init__(self):
        self._open = threading.Event()
        self._open.set()
        self.is_reached = threading.Event()

    def hold(self):
        self.is_reached.clear()
        self._open.clear()

    def let_go(self):
        self._open.set()

    def go_through(self, cancelled=never):
        self.is_reached.set()
        while not self._open.wait(0.001):
            if cancelled():
                raise CancelledError("abandoned at the gate")


class Recorder:
    """Both callbacks of a pipeline. Each estimate can be held up before it is handed out."""

    def __init__(self):
        self.gate, self.handed_out, self.failures = Gate(), [], []
        self.error = self.failure_error = None

    def on_estimate(self, job, estimate):
        self.gate.go_through()
        if self.error is not None:
            raise self.error
        self.handed_out.append((job, estimate))

    def on_failure(self, job, error):
        self.failures.append((job, error))
        if self.failure_error is not None:
            raise self.failure_error

    @property
    def current_stamps(self):
        return [job.triplet.current.stamp_ns for job, _ in self.handed_out]


def counts_of(pipeline):
    return pipeline.statistics.snapshot().counts


def assert_balanced(pipeline):
    """Each triplet ends in exactly one way."""
    counts = counts_of(pipeline)
    assert counts["triplets_formed"] == sum(counts[end] for end in TRIPLET_ENDS)
