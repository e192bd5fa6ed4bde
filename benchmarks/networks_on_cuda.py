# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Time and memory of the networks on CUDA.

    python benchmarks/networks_on_cuda.py [--document FILE] [--sweeps N] [--device cuda]

Sweeps are those of KITTI 0005 if the shared data is there (see drives.py), else those of a
simulated street. Without CUDA nothing is measured; `--device cpu` tries the script itself.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import torch
from drives import TrueSweep, real_sweeps, simulated_sweeps, triplet_at
from frame import TARGET_HEADER, Table, Target, make_parser, publish

from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset

# Estimates before the clock counts: the first ones load kernels.
_NUM_WARM_UP: Final = 2
_MAX_P95_MS: Final = 150.0
# Rows: PRESET/METHOD; the first has the target.
ROWS: Final = ("paper/mnsf", "paper/mnsf+compute.cuda_graphs=false", "authors/mnsf", "paper/nsfp")


def main() -> None:
    """Measures everything, prints the table, and writes it into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--sweeps", type=int, default=100, help="estimates of each row")
    options = parser.parse_args()
    if options.device == "cuda" and not torch.cuda.is_available():
        print("torch finds no usable CUDA device: nothing is measured")
        return
    # Without times of points: real ones are motion compensated, and registration takes them so.
    sweeps = [
        replace(item, sweep=replace(item.sweep, times_s=None))
        for item in real_sweeps("kitti_0005") or simulated_sweeps(0, 24)
    ]
    device = torch.cuda.get_device_name() if options.device == "cuda" else "CPU"
    title = f"{device}, torch {torch.__version__}, {len(sweeps[0].sweep):,} points a sweep"
    measured = {name: _measured(name, sweeps, options.device, options.sweeps) for name in ROWS}
    rows = [[name, *(f"{value:.1f}" for value in values)] for name, values in measured.items()]
    target = Target(f"p95 (ms): {ROWS[0]}", _MAX_P95_MS, measured[ROWS[0]][1])
    header = ("preset/method", "median (ms)", "p95 (ms)", "memory (MB)")
    tables = [Table(title, header, rows), Table("Target", TARGET_HEADER, [target.row()])]
    publish("cuda", tables, options.document)


def _measured(name: str, sweeps: Sequence[TrueSweep], device: str, number: int) -> list[float]:
    """Median and p95 of the time (ms), and peak of the memory (MB), NaN on the CPU."""
    preset_name, method = name.split("/")
    estimator = make_method(method, preset(preset_name).changed({"compute.device": device}))
    if device == "cuda":
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()
    times_ms = []
    for count in range(number + _NUM_WARM_UP):
        # After the last sweep comes the first: time steps back, and the estimate starts cold.
        triplet = triplet_at(sweeps, 1 + count % (len(sweeps) - 2))
        start = time.perf_counter()
        estimator.estimate(triplet)
        times_ms.append(1e3 * (time.perf_counter() - start))
    median_ms, p95_ms = np.percentile(times_ms[_NUM_WARM_UP:], (50, 95))
    memory_mb = torch.cuda.max_memory_reserved() / 1e6 if device == "cuda" else float("nan")
    return [median_ms, p95_ms, memory_mb]


if __name__ == "__main__":
    main()
