# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Time and memory of the networks on CUDA, and time of the distance to a sweep.

    python benchmarks/networks_on_cuda.py [--document FILE] [--sweeps N] [--device cuda]

Sweeps are those of KITTI 0005 if the shared data is there (see drives.py), else those of a
simulated street. Without CUDA nothing is measured; `--device cpu --sweeps 0` measures the distance
on the CPU.
"""

import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import torch
from drives import TrueSweep, real_sweeps, simulated_sweeps, triplet_at
from frame import TARGET_HEADER, Table, Target, make_parser, publish

from mnsf_ros.methods import make_method
from mnsf_ros.networks.target_distance import TargetDistance
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.kept_points import crop_mask, fit_mask
from mnsf_ros.sweeps.sweep import Sweep

# Estimates before the clock counts: the first ones load kernels.
_NUM_WARM_UP: Final = 2
_MAX_P95_MS: Final = 150.0
_MAX_WARM_P95_MS: Final = 80.0
# Rows: PRESET/METHOD. The first and the last one have targets; the last one are networks of the
# paper's size that go on from sweep to sweep, on all points of what may move.
ROWS: Final = (
    "paper/mnsf",
    "paper/mnsf+distance.kind=bricks+distance.truncation_m=2",
    "paper/mnsf+compute.cuda_graphs=false",
    "authors/mnsf",
    "paper/nsfp",
    "mnsf/mnsf+field.num_hidden_layers=8+field.hidden_width=128+optimization.max_points=0",
)
# Time of bricks over that of the grid, which edt makes, for a whole sweep on one core.
_MAX_RATIO: Final = 0.3
# Every so many sweeps is a target; the least time of three counts.
_TARGET_EVERY: Final = 8
_NUM_REPETITIONS: Final = 3
_NUM_POSITIONS: Final = (1024, 30_000)


def main() -> None:
    """Measures everything, prints the tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--device", choices=("cuda", "cpu"), default="cuda")
    parser.add_argument("--sweeps", type=int, default=100, help="estimates of each row; 0: no rows")
    options = parser.parse_args()
    if options.device == "cuda" and not torch.cuda.is_available():
        print("torch finds no usable CUDA device: nothing is measured")
        return
    # Without times of points: real ones are motion compensated, and registration takes them so.
    sweeps = [
        replace(item, sweep=replace(item.sweep, times_s=None))
        for item in real_sweeps("kitti_0005") or simulated_sweeps(0, 24)
    ]
    publish("cuda", _tables(sweeps, options.device, options.sweeps), options.document)


def _tables(sweeps: Sequence[TrueSweep], device: str, number: int) -> Iterator[Table]:
    distances = _distances(sweeps, device)
    positions = [f"{count:,} positions (ms)" for count in _NUM_POSITIONS]
    header = ("distance", "whole sweep (ms)", "without ground (ms)", *positions)
    yield Table("Built, and looked up with its gradient", header, _rows(distances))
    ratio = distances["bricks, one core"][0] / distances["grid, one core"][0]
    targets = [Target("bricks over grid, whole sweep, one core", _MAX_RATIO, ratio)]
    if number:
        measured = {name: _measured(name, sweeps, device, number) for name in ROWS}
        header = ("preset/method", "median (ms)", "p95 (ms)", "memory (MB)")
        name = torch.cuda.get_device_name() if device == "cuda" else "CPU"
        title = f"{name}, torch {torch.__version__}, {len(sweeps[0].sweep):,} points a sweep"
        yield Table(title, header, _rows(measured))
        for name, limit_ms in ((ROWS[0], _MAX_P95_MS), (ROWS[-1], _MAX_WARM_P95_MS)):
            targets.append(Target(f"p95 (ms): {name}", limit_ms, measured[name][1]))
    yield Table("Target", TARGET_HEADER, [target.row() for target in targets])


def _rows(values: Mapping[str, Sequence[float]]) -> list[list[str]]:
    return [[name, *(f"{value:.1f}" for value in own)] for name, own in values.items()]


def _distances(sweeps: Sequence[TrueSweep], device: str) -> dict[str, Sequence[float]]:
    """Mean times (ms) of each kind of distance: on one core, then on CUDA."""
    num_threads, first = torch.get_num_threads(), sweeps[0].sweep
    positions = torch.from_numpy(first.xyz[fit_mask(first, preset("paper"))])
    chosen = torch.linspace(0, len(positions) - 1, max(_NUM_POSITIONS)).long()
    rows = {}
    for place in dict.fromkeys(("cpu", device)):
        torch.set_num_threads(1 if place == "cpu" else num_threads)
        some = positions[chosen].to(place)
        for kind in ("grid", "bricks", "tree"):
            times_ms = [_distance_ms(kind, item.sweep, some) for item in sweeps[1::_TARGET_EVERY]]
            name = f"{kind}, {'one core' if place == 'cpu' else place}"
            rows[name] = np.mean(times_ms, axis=0).tolist()
    torch.set_num_threads(num_threads)
    return rows


def _distance_ms(kind: str, target: Sweep, positions: torch.Tensor) -> list[float]:
    """Times (ms) to build the distance to a sweep, whole and without ground, and to look it up."""
    changes = {"kind": kind, "truncation_m": 2.0, "max_cells": 2_000_000_000}
    settings = preset("paper").changed({f"distance.{key}": changes[key] for key in changes})
    masks = crop_mask(target.xyz, settings.crop), fit_mask(target, settings)
    points = [torch.from_numpy(target.xyz[mask]).to(positions.device) for mask in masks]
    builds = [partial(TargetDistance, each, settings.distance) for each in points]
    distance = builds[1]()

    def look_up(count: int) -> None:
        some = positions[:: len(positions) // count][:count].requires_grad_()
        torch.autograd.grad(distance.mean(some), some)

    calls = [*builds, *(partial(look_up, count) for count in _NUM_POSITIONS)]
    return [_least_ms(call, positions.is_cuda) for call in calls]


def _least_ms(call: Callable[[], object], is_on_cuda: bool) -> float:
    """CPU time (ms) of a call, on CUDA its wall time."""
    clock, times_ms = time.perf_counter if is_on_cuda else time.process_time, []
    for _ in range(_NUM_REPETITIONS):
        start = clock()
        call()
        if is_on_cuda:
            torch.cuda.synchronize()
        times_ms.append(1e3 * (clock() - start))
    return min(times_ms)


def _measured(name: str, sweeps: Sequence[TrueSweep], device: str, number: int) -> list[float]:
    """Median and p95 of the time (ms), and peak of the memory (MB), NaN on the CPU."""
    estimator = make_method(name, preset("paper").changed({"compute.device": device}))
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
