# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What each freedom of the method `neural` buys: errors and CPU without one at a time.

    python benchmarks/neural_steps.py [--document FILE]

On the second half of KITTI 0005, if the shared data is there (see drives.py), and on a street.
"""

import os
import time
from collections.abc import Iterator
from typing import Any, Final
from unittest.mock import patch

# Before libraries with threads of their own are loaded.
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from drives import TrueSweep, real_sweeps, simulated_sweeps, triplet_at
from frame import Table, make_parser, publish

from mnsf_ros.evaluation.metrics import by_motion
from mnsf_ros.methods import make_method, neural_estimator
from mnsf_ros.objects import encoded_field
from mnsf_ros.objects.scene import ReadySweeps
from mnsf_ros.presets import preset

_STREET_SEED: Final = 3
_NUM_SWEEPS: Final = 24
_PARTS: Final = ("dynamic", "static")


# Row to what is replaced: owner, name and value.
_STEPS: Final[dict[str, tuple[Any, str, Any]]] = {
    "no offsets": (encoded_field, "_PRIOR", np.diag((1e-3, 1e9, 1e9))),
    "no older sweeps": (ReadySweeps, "past", lambda *_: []),
    # The last of the flows to fuse is the mean of f and f', the first one f.
    "mean as fusion": (neural_estimator, "fused", lambda flows: flows[-1].heads),
    "forward alone": (neural_estimator, "fused", lambda flows: flows[0].heads),
}


def main() -> None:
    """Measures all rows, prints the table, and writes it into a document."""
    options = make_parser(__doc__).parse_args()
    publish("neural", _tables(), options.document)


def _tables() -> Iterator[Table]:
    kitti = real_sweeps("kitti_0005")[:_NUM_SWEEPS]
    drives = {"street": simulated_sweeps(_STREET_SEED, _NUM_SWEEPS)}
    drives = {"KITTI 0005": kitti, **drives} if kitti else drives
    header = [*(f"{drive}: {part}" for drive in drives for part in _PARTS), "CPU (ms)"]
    methods = {"online": "online", "neural": "neural"}
    methods["from scratch"] = "neural+warm_start.enabled=false"
    rows = [[name, *_figures(drives, method)] for name, method in methods.items()]
    for name, (owner, attribute, value) in _STEPS.items():
        with patch.object(owner, attribute, value):
            rows.append([name, *_figures(drives, "neural")])
    yield Table("EPE (m), second half of each drive", ["", *header], rows)


def _figures(drives: dict[str, list[TrueSweep]], method: str) -> list[str]:
    """Mean errors over the second half of each drive; CPU time of an estimate on the first."""
    measured = [_measured(sweeps, method) for sweeps in drives.values()]
    errors = [f"{error_m:.3f}" for errors_m, _ in measured for error_m in errors_m]
    return [*errors, f"{measured[0][1]:.0f}"]


def _measured(sweeps: list[TrueSweep], method: str) -> tuple[list[float], float]:
    estimator = make_method(method, preset("neural" if "neural" in method else method))
    errors, times_ms = [], []
    for index in range(1, len(sweeps) - 1):
        start_s = time.process_time()
        estimate = estimator.estimate(triplet_at(sweeps, index))
        times_ms.append(1e3 * (time.process_time() - start_s))
        truth = sweeps[index]
        if index >= len(sweeps) // 2:
            known = (estimate.flow, truth.truth.flow, truth.truth.dynamic)
            errors.append(by_motion(*(values[truth.scored] for values in known)))
    means_m = [float(np.nanmean([each[part].epe_m for each in errors])) for part in _PARTS]
    return means_m, float(np.median(times_ms[len(times_ms) // 2 :]))


if __name__ == "__main__":
    main()
