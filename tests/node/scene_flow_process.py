"""The scene flow node as its own process."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

from waiting import PATIENCE_S

_CHECKOUT = Path(__file__).resolve().parents[2]

# An estimate of some 70 ms, whatever else the machine does: no time budget.
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
    "warm_start.max_iterations": 30,
    "compute.num_threads": 1,
    "node.diagnostics_period_s": 0.05,
    "node.always_estimate": "true",
}

# An estimate that takes minutes, in many short steps.
SLOW = QUICK | {
    "optimization.max_iterations": 100_000,
    "warm_start.max_iterations": 100_000,
}


def parameter_arguments(parameters):
    """`-p name:=value` for each of the parameters."""
    return [word for name, value in parameters.items() for word in ("-p", f"{name}:={value}")]


class SceneFlowProcess:
    """`python -m mnsf_ros.node --ros-args ...`; what it logs goes to a file."""

    def __init__(self, log_path, ros_arguments, environment=None):
        self._log_path = log_path
        with log_path.open("w") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "mnsf_ros.node", "--ros-args", *ros_arguments],
                stdout=log,
                stderr=log,
                cwd=_CHECKOUT,
                env=os.environ | (environment or {}),
            )

    @property
    def log(self):
        """What the node has written so far."""
        return self._log_path.read_text()

    @property
    def pid(self):
        return self._process.pid

    @property
    def is_running(self):
        return self._process.poll() is None

    def send_signal(self, number):
        self._process.send_signal(number)

    def wait(self):
        """Exit status, once the process has ended by itself."""
        return self._process.wait(PATIENCE_S)

    def stop(self, number=signal.SIGINT):
        """Sends a signal and returns the exit status."""
        self.send_signal(number)
        return self.wait()

    def kill(self):
        """Ends the process if it still runs."""
        if self.is_running:
            self._process.kill()
        self._process.wait()
