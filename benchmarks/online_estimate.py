"""Time of an estimate on full simulated sweeps, stage by stage, as a robot would see it.

    python benchmarks/online_estimate.py [--preset online] [--beams 64] [--sweeps 12] [--threads 1]

Every triplet is estimated, warm-started from the one before. Prints the medians after the first
three triplets, and the errors.
"""

from __future__ import annotations

import argparse
import os

# Before torch is loaded; the node does the same.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

import numpy as np
from rich.console import Console

from mnsf_ros.core.multi_frame import MultiFrameEstimator
from mnsf_ros.evaluation.metrics import by_motion, mean_of
from mnsf_ros.evaluation.tables import TextTable, errors_table
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import simulate_sweeps
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_WARM_UP = 3


def main() -> None:
    """Estimates all triplets and prints the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--preset", choices=PRESET_NAMES, default="online")
    parser.add_argument("--beams", type=int, default=64)
    parser.add_argument("--sweeps", type=int, default=12)
    parser.add_argument("--threads", type=int, default=1)
    options = parser.parse_args()
    settings = preset(options.preset).changed({"compute.num_threads": options.threads})
    estimator = MultiFrameEstimator(settings)
    simulation = SimulationSettings(num_beams=options.beams, duration_s=options.sweeps / 10)
    simulated = list(simulate_sweeps(simulation))
    sweeps = [Sweep(item.xyz, item.stamp_ns, "lidar") for item in simulated]
    estimates, errors = [], {"all": [], "dynamic": [], "static": []}
    for index in range(1, len(sweeps) - 1):
        estimate = estimator.estimate(SweepTriplet(*sweeps[index - 1 : index + 2]))
        estimates.append(estimate)
        truth = simulated[index]
        for name, value in by_motion(
            estimate.flow, truth.flow, truth.dynamic, ~truth.ground
        ).items():
            errors[name].append(value)
    console = Console(width=120)
    stages = [estimate.times_ms for estimate in estimates[_WARM_UP:]]
    rows = [(stage, f"{np.median([item[stage] for item in stages]):.0f}") for stage in stages[0]]
    rows.append(("whole", f"{np.median([sum(item.values()) for item in stages]):.0f}"))
    points = f"{np.mean([len(sweep) for sweep in sweeps]):.0f} points a sweep"
    title = f"{options.preset}, {points}, {options.threads} torch threads, {estimates[0].device}"
    console.print(TextTable(("stage", "median (ms)"), rows, title).rich())
    means = {name: mean_of(values[_WARM_UP:]) for name, values in errors.items()}
    console.print(errors_table(means, row_title="without ground").rich())


if __name__ == "__main__":
    main()
