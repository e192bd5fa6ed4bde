# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The scene flow node as its own process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

# Far more than a loaded machine needs: only a failing test waits that long.
PATIENCE_S = 120.0

_CHECKOUT = Path(__file__).resolve().parents[2]

# The default but for ground, which the clouds of the tests have none of: an estimate of some 30 ms.
# With `method.name` mnsf it is one of some 70 ms, however slow the machine is: no time budget.
QUICK = {
    "ground.remove": "false",
    "field.num_hidden_layers": 2,
    "field.hidden_width": 32,
    "fusion.num_hidden_layers": 2,
    "fusion.hidden_width": 16,
    "fusion.max_iterations": 30,
    "optimization.max_iterations": 80,
    "optimization.learning_rate": 0.01,
    "optimization.batch_points": 256,
    "optimization.time_budget_ms": 0,
    "warm_start.time_budget_ms": 0,
    "warm_start.max_iterations": 30,
    "compute.num_threads": 1,
    "compute.device": "cpu",
    "node.diagnostics_period_s": 0.05,
    "node.always_estimate": "true",
    # However long a slow machine makes the pauses between two sweeps.
    "node.stale_after_s": 60.0,
}

RESTING = QUICK | {"node.always_estimate": "false"}

NETWORK = QUICK | {"method.name": "mnsf"}

# An estimate that takes minutes on any machine, in many short steps.
ENDLESS = NETWORK | {"optimization.max_iterations": 100_000, "field.hidden_width": 128}

# An estimate that is most of its time inside one library call, which takes a second or more.
LONG_CALLS = NETWORK | {"distance.kind": "grid", "distance.cell_size_m": 0.06}

# What the process of the tests has set for itself, and the node has to set on its own.
_PREPARED = (
    *("FASTRTPS_DEFAULT_PROFILES_FILE", "FASTDDS_DEFAULT_PROFILES_FILE"),
    *("RMW_FASTRTPS_USE_QOS_FROM_XML", "OMP_WAIT_POLICY"),
)

# As the executable scene_flow_lifecycle_node does.
_LIFE_CYCLE = "from mnsf_ros.node.__main__ import lifecycle_main; lifecycle_main()"


class SceneFlowProcess:
    """`python -m mnsf_ros.node --ros-args ...`, or the node with a life cycle; it writes to a file.

    Attributes:
        num_expected_tracebacks: How many of them a test has provoked.
    """

    num_expected_tracebacks = 0

    def __init__(self, log_path, parameters, ros_arguments, *, has_life_cycle=False):
        self._log_path = log_path
        words = [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]
        program = ["-c", _LIFE_CYCLE] if has_life_cycle else ["-m", "mnsf_ros.node"]
        with log_path.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, *program, "--ros-args", *ros_arguments, *words],
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=log,
                cwd=_CHECKOUT,
                env={name: value for name, value in os.environ.items() if name not in _PREPARED}
                | {"PYTHONFAULTHANDLER": "1"},
            )

    @property
    def log(self):
        """What the node has written so far."""
        return self._log_path.read_text()

    @property
    def is_running(self):
        return self._process.poll() is None

    def has_loaded(self, library):
        """Whether a shared library of that name is in the memory of the process."""
        return library in Path(f"/proc/{self._process.pid}/maps").read_text()

    def send_signal(self, number):
        self._process.send_signal(number)

    def wait(self):
        """Exit status, once the process has ended by itself."""
        try:
            return self._process.wait(PATIENCE_S)
        except subprocess.TimeoutExpired:
            # All its threads write where they are.
            self._process.send_signal(signal.SIGABRT)
            self._process.wait()
            raise AssertionError(self.log) from None

    def stop(self, number=signal.SIGINT):
        """Sends a signal and returns the exit status."""
        self.send_signal(number)
        return self.wait()

    def end(self):
        """Ends the process if it still runs, whatever state it is in."""
        if self.is_running:
            self._process.terminate()
            try:
                self._process.wait(5)
            except subprocess.TimeoutExpired:
                self._process.kill()
        self._process.wait()
