# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The networks on CUDA: correctness against the CPU, time and memory, in one run.

    python benchmarks/networks_on_cuda.py [--document FILE] [--sweeps N] [--device cuda]

Each method that fits networks is compared with itself on the CPU, then timed on full sweeps with
its preset. Sweeps are those of KITTI 0005 if the shared data is there (see drives.py), else those
of a simulated street. Without CUDA nothing is measured; `--device cpu` tries the script itself.
`neural` runs on the CPU only, and is not among them.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Mapping, Sequence
from typing import Final

import numpy as np
import torch
from drives import TrueSweep, real_sweeps, simulated_sweeps, triplet_at
from frame import Table, make_parser, publish, this_machine, verdict

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.target_distance import DistanceTransform, GridBox, distances_within
from mnsf_ros.evaluation.metrics import by_motion
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import crop_mask
from mnsf_ros.sweeps.sweep import Sweep

_FNSF: Final = ("fnsf", "fnsf-linear", "fnsf-joint", "fnsf-time")
METHODS: Final = ("mnsf", *_FNSF, "mnsf-cycle", "nsfp", "nsfp-linear")
# Few steps on the same points: rounding has no time to grow. Coarse grids: fast on a CPU.
_FEW_STEPS: Final[dict[str, SettingValue]] = {
    "optimization.max_iterations": 8,
    "fusion.max_iterations": 8,
    "distance.cell_size_m": 0.5,
}
# Rounding alone makes up to 1.1 mm: Adam's first steps have the sign of the gradient, however small
# it is.
_MAX_MEAN_DIFFERENCE_MM: Final = 3.0
_MAX_GRID_DIFFERENCE_MM: Final = 0.01
_REACH_M: Final = 2.0
# Estimates before the clock counts: the first ones load kernels.
_NUM_WARM_UP: Final = 2


# PRESET/METHOD of the table of times, with the target of the 95th percentile in ms.
TIMED: Final[dict[str, float | None]] = {
    "paper/mnsf": 150.0,
    "paper/mnsf+compute.cuda_graphs=false": None,
    "authors/mnsf": None,
    **{f"paper/{method}": None for method in METHODS[1:]},
}
# Rows without a target get this share of the estimates.
_SHARE: Final = 0.1
_TIMES_HEADER: Final = (
    *("preset/method", "median (ms)", "p95 (ms)", "p95 target", "EPE (m)", "EPE dynamic"),
    *("EPE static", "memory (MB)", "longest stages (ms)"),
)
_CHECKS_HEADER: Final = ("checked against the CPU", "difference (mm)", "at most", "")


def main() -> None:
    """Measures everything, prints the tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--sweeps", type=int, default=100, help="estimates of the longest row")
    parser.add_argument("--points", type=int, default=0, help="points of a sweep; 0: all")
    parser.add_argument("--few-steps", action="store_true", help="8 steps a network, to try it out")
    options = parser.parse_args()
    if options.device == "cuda" and not torch.cuda.is_available():
        print("torch finds no usable CUDA device: nothing is measured")
        return
    sweeps = _sweeps(options.points)
    device = torch.cuda.get_device_name() if options.device == "cuda" else "CPU"
    points = f"{len(sweeps[0].sweep):,} points a sweep"
    machine = f"{this_machine()}, {device}, torch {torch.__version__}, {points}"
    publish("cuda", _tables(sweeps, options), options.document, machine)


def _tables(sweeps: Sequence[TrueSweep], options: argparse.Namespace) -> Iterator[Table]:
    checks = list(_checks(sweeps, options.device))
    yield Table("Correctness", _CHECKS_HEADER, checks, is_detail=True)
    num_same = sum(cells[-1] == "same" for cells in checks)
    title = f"{num_same} of {len(checks)} results are those of the CPU"
    rows = [[name, *_timed(name, sweeps, options)] for name in TIMED]
    yield Table(title, _TIMES_HEADER, rows)


def _sweeps(num_points: int) -> list[TrueSweep]:
    found = real_sweeps("kitti_0005") or simulated_sweeps(0, 24)
    return [_thinned(item, num_points) for item in found]


def _thinned(item: TrueSweep, num_points: int) -> TrueSweep:
    xyz, number = item.sweep.xyz, len(item.sweep.xyz)
    chosen = num_points if 0 < num_points < number else number
    rows = np.sort(np.random.default_rng(0).permutation(number)[:chosen])
    # Without times of points: real ones are motion compensated, and registration takes them so.
    sweep = Sweep(np.ascontiguousarray(xyz[rows]), item.sweep.stamp_ns, item.sweep.frame_id)
    truth = (item.flow, item.dynamic, item.scored, item.ground)
    return TrueSweep(sweep, item.pose, *(None if part is None else part[rows] for part in truth))


def _checks(sweeps: Sequence[TrueSweep], device: str) -> Iterator[list[str]]:
    """One row for each result that must be the same on the device as on the CPU."""
    points = torch.from_numpy(sweeps[1].sweep.xyz)
    points = points[points.norm(dim=1) < 30]
    box = GridBox.around(points, 0.2)
    on_cpu = DistanceTransform.from_points(points, box).distances
    ours = distances_within(points.to(device), box, _REACH_M).cpu()
    difference_mm = 1e3 * float((on_cpu - ours)[on_cpu <= _REACH_M].abs().max())
    yield _check("distance transform", difference_mm, _MAX_GRID_DIFFERENCE_MM)
    three = [_thinned(item, 8192) for item in sweeps[:3]]
    for method in METHODS:
        few = preset("paper").changed(_FEW_STEPS)
        flows = [
            _estimate(method, few.changed({"compute.device": each}), three).flow
            for each in ("cpu", device)
        ]
        difference_mm = 1e3 * float(np.linalg.norm(flows[0] - flows[1], axis=1).mean())
        yield _check(f"{method}, 8 steps", difference_mm, _MAX_MEAN_DIFFERENCE_MM)


def _check(name: str, difference_mm: float, limit_mm: float) -> list[str]:
    # A NaN is not the same.
    text = "same" if difference_mm <= limit_mm else "DIFFERS"
    return [name, f"{difference_mm:.4f}", f"{limit_mm:g}", text]


def _estimate(method: str, settings: Settings, sweeps: Sequence[TrueSweep]) -> FlowEstimate:
    return make_method(method, settings).estimate(triplet_at(sweeps, 1))


def _timed(name: str, sweeps: Sequence[TrueSweep], options: argparse.Namespace) -> list[str]:
    """Times, errors and memory of a row on full sweeps."""
    preset_name, method = name.split("/")
    settings = preset(preset_name).changed({"compute.device": options.device})
    settings = settings.changed(_FEW_STEPS) if options.few_steps else settings
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
