# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The networks on CUDA: time, errors and memory, in one run.

    python benchmarks/networks_on_cuda.py [--document FILE] [--sweeps N] [--device cuda]

Sweeps are those of KITTI 0005 if the shared data is there (see drives.py), else those of a
simulated street. Without CUDA nothing is measured; `--device cpu` tries the script itself.
`neural` runs on the CPU only. That results are those of the CPU is tested in tests/methods.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
import torch
from drives import TrueSweep, real_sweeps, simulated_sweeps, triplet_at
from frame import Table, make_parser, publish, this_machine, verdict

from mnsf_ros.evaluation.metrics import by_motion
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.kept_points import crop_mask

# Estimates before the clock counts: the first ones load kernels.
_NUM_WARM_UP: Final = 2
_OTHERS: Final = (
    *("fnsf", "fnsf-linear", "fnsf-joint", "fnsf-time", "mnsf-cycle", "nsfp", "nsfp-linear"),
)
# PRESET/METHOD of the table of times, with the target of the 95th percentile in ms.
TIMED: Final[dict[str, float | None]] = {
    "paper/mnsf": 150.0,
    "paper/mnsf+compute.cuda_graphs=false": None,
    "authors/mnsf": None,
    **{f"paper/{method}": None for method in _OTHERS},
}
# Rows without a target get this share of the estimates.
_SHARE: Final = 0.1
_TIMES_HEADER: Final = (
    *("preset/method", "median (ms)", "p95 (ms)", "p95 target", "EPE (m)", "EPE dynamic"),
    *("EPE static", "memory (MB)", "longest stages (ms)"),
)


def main() -> None:
    """Measures everything, prints the tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--sweeps", type=int, default=100, help="estimates of the longest row")
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
    points = f"{len(sweeps[0].sweep):,} points a sweep"
    machine = f"{this_machine()}, {device}, torch {torch.__version__}, {points}"
    rows = [[name, *_timed(name, sweeps, options)] for name in TIMED]
    publish("cuda", [Table("Full sweeps", _TIMES_HEADER, rows)], options.document, machine)


def _timed(name: str, sweeps: Sequence[TrueSweep], options: argparse.Namespace) -> list[str]:
    """Times, errors and memory of a row on full sweeps."""
    preset_name, method = name.split("/")
    settings = preset(preset_name).changed({"compute.device": options.device})
    limit_ms = TIMED[name]
    number = max(1, round(options.sweeps * (1 if limit_ms else _SHARE)))
    estimator = make_method(method, settings)
    is_on_cuda = settings.compute.device == "cuda"
    if is_on_cuda:
        torch.cuda.empty_cache()
        torch.cuda.reset_peak_memory_stats()
    times_ms, stages, errors = [], [], []
    for count in range(number + _NUM_WARM_UP):
        # After the last sweep comes the first: time steps back, and the estimate starts cold.
        index = 1 + count % (len(sweeps) - 2)
        triplet = triplet_at(sweeps, index)
        start = time.perf_counter()
        estimate = estimator.estimate(triplet)
        if count < _NUM_WARM_UP:
            continue
        times_ms.append(1e3 * (time.perf_counter() - start))
        stages.append(estimate.times_ms)
        truth = sweeps[index]
        if truth.flow is None or truth.dynamic is None or truth.scored is None:
            continue
        scored = truth.scored & crop_mask(truth.sweep.xyz, settings.crop)
        known = (estimate.flow[scored], truth.flow[scored], truth.dynamic[scored])
        errors.append(by_motion(*known))
    p95_ms = float(np.percentile(times_ms, 95))
    target = f"{limit_ms:g} {verdict(p95_ms <= limit_ms)}" if limit_ms else ""
    return [
        f"{np.median(times_ms):.1f}",
        f"{p95_ms:.1f}",
        target,
        *(
            f"{np.nanmean([each[part].epe_m for each in errors]):.3f}"
            for part in ("all", "dynamic", "static")
        ),
        f"{torch.cuda.max_memory_reserved() / 1e6:.0f}" if is_on_cuda else "-",
        _longest(stages),
    ]


def _longest(stages: Sequence[Mapping[str, float]]) -> str:
    medians = {name: np.median([each.get(name, 0.0) for each in stages]) for name in stages[-1]}
    longest = sorted(medians.items(), key=lambda item: -item[1])[:3]
    return ", ".join(f"{name} {median_ms:.0f}" for name, median_ms in longest)


if __name__ == "__main__":
    main()
