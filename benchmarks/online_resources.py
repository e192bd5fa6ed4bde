# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Memory, reproducibility and cost against size of the online preset."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from online_recordings import (
    INTERVAL_NS,
    real_sweeps,
    simulated_drive,
    simulated_sweeps,
    to_and_fro,
)

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

_NUM_SWEEPS: Final = 10_000
_NUM_FULL: Final = 300
_MAX_MEMORY_GB: Final = 1.5
# Growth between the first and the last tenth that counts as flat.
_MAX_GROWTH_MB: Final = 20
# A drive this long, and how many of its last sweeps a fresh estimator sees, too. Its first ones do
# not count: tracks and older sweeps are not known yet.
_NUM_OF_DRIVE: Final = 400
_NUM_FRESH: Final = 60
_NUM_OF_START: Final = 20
# Above 1 by more than this is no noise.
_MAX_COST_OF_AGE: Final = 1.1
# Beams, columns: from 8,000 to 400,000 points.
_SIZES: Final = ((16, 520), (32, 1000), (64, 1000), (64, 1900), (128, 1900), (128, 3300))


def resource_tables(*, quick: bool) -> Iterator[TextTable]:
    """Tables of memory and reproducibility, and of cost against size."""
    full = [item.sweep for item in real_sweeps("kitti_0005")[:24]]
    full = full or [item.sweep for item in simulated_sweeps(0, 24)]
    number = _NUM_OF_DRIVE // (4 if quick else 1)
    turns = to_and_fro(full)
    back_and_forth = (
        replace(turns[index % len(turns)], stamp_ns=10**18 + index * INTERVAL_NS, times_s=None)
        for index in range(number)
    )
    rows = [
        _same_output_row(),
        *_memory_rows(full, quick),
        _age_row("simulated street", (item.sweep for item in simulated_drive(0, number)), number),
        _age_row("KITTI 0005 to and fro", back_and_forth, number),
    ]
    header = ["target", "limit", "measured", ""]
    yield TextTable(header, rows, "Memory and reproducibility")
    yield _size_table()


def _memory_rows(full: Sequence[Sweep], quick: bool) -> Iterator[list[str]]:
    peak_gb = max(_memory_mb(full, _NUM_FULL // (10 if quick else 1))) / 1e3
    verdict = "met" if peak_gb <= _MAX_MEMORY_GB else "MISSED"
    text = f"{peak_gb:.2f} GB"
    yield ["memory of the process, full sweeps", f"{_MAX_MEMORY_GB} GB", text, verdict]
    small = [Sweep(sweep.xyz[::8], sweep.stamp_ns, sweep.frame_id) for sweep in full]
    number = _NUM_SWEEPS // (10 if quick else 1)
    memory_mb = _memory_mb(small, number)
    tenth = len(memory_mb) // 10
    growth_mb = float(np.median(memory_mb[-tenth:]) - np.median(memory_mb[tenth : 2 * tenth]))
    verdict = "met" if growth_mb <= _MAX_GROWTH_MB else "MISSED"
    name = f"growth of memory over {number:,} sweeps, an eighth of the points"
    yield [name, f"{_MAX_GROWTH_MB} MB", f"{growth_mb:.1f} MB", verdict]


def _memory_mb(sweeps: Sequence[Sweep], number: int) -> list[float]:
    estimator = make_method("online", preset("online"))
    recent: list[Sweep] = []
    memory_mb = []
    turns = to_and_fro(sweeps)
    for index in range(number):
        turn = turns[index % len(turns)]
        sweep = Sweep(turn.xyz, 10**18 + index * INTERVAL_NS, turn.frame_id)
        recent = [*recent[-2:], sweep]
        if len(recent) == 3:
            estimator.estimate(SweepTriplet(*recent))
            memory_mb.append(_resident_mb())
    return memory_mb


def _age_row(name: str, sweeps: Iterable[Sweep], number: int) -> list[str]:
    """CPU of estimates at the end of a long drive over a fresh estimator's, in turns."""
    old, fresh = (make_method("online", preset("online")) for _ in range(2))
    recent: list[Sweep] = []
    shares = []
    for index, sweep in enumerate(sweeps):
        recent = [*recent[-2:], sweep]
        if len(recent) < 3:
            continue
        triplet = SweepTriplet(*recent)
        own_ms = _cpu_ms(old, triplet)
        if index >= number - _NUM_FRESH:
            shares.append(own_ms / _cpu_ms(fresh, triplet))
    share = float(np.median(shares[_NUM_OF_START:]))
    verdict = "met" if share <= _MAX_COST_OF_AGE else "MISSED"
    name = f"CPU of an estimate after {number} sweeps, {name}, over that of a fresh estimator"
    return [name, f"{_MAX_COST_OF_AGE}", f"{share:.2f}", verdict]


def _cpu_ms(estimator: SceneFlowEstimator, triplet: SweepTriplet) -> float:
    start_s = time.process_time()
    estimator.estimate(triplet)
    return 1e3 * (time.process_time() - start_s)


def _resident_mb() -> float:
    pages = int(Path("/proc/self/statm").read_text().split()[1])
    return pages * os.sysconf("SC_PAGE_SIZE") / 1e6


def _same_output_row() -> list[str]:
    digests = {
        subprocess.run(
            [sys.executable, __file__],
            env=os.environ | {"OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads},
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        for threads in ("1", "2", "2")
    }
    name = "same output, three processes with 1, 2, 2 threads"
    return [name, "1 output", f"{len(digests)} output", "met" if len(digests) == 1 else "MISSED"]


def _print_digest() -> None:
    """What a fresh process makes of a street, as a hash."""
    sweeps = [item.sweep for item in simulated_sweeps(5, 10)]
    settings = preset("online").changed({"compute.num_threads": int(os.environ["OMP_NUM_THREADS"])})
    estimator = make_method("online", settings)
    digest = hashlib.sha256()
    for index in range(1, len(sweeps) - 1):
        digest.update(
            estimator.estimate(SweepTriplet(*sweeps[index - 1 : index + 2])).flow.tobytes()
        )
    print(digest.hexdigest())


def _size_table() -> TextTable:
    rows, costs = [], []
    for beams, columns in _SIZES:
        sweeps = [s.sweep for s in simulated_sweeps(0, 12, num_beams=beams, num_columns=columns)]
        num_points = float(np.mean([len(sweep) for sweep in sweeps]))
        times_ms = _times_ms(sweeps)
        costs.append((num_points, float(np.median(times_ms))))
        rows.append([f"{beams} x {columns}", f"{num_points:,.0f}", f"{costs[-1][1]:.0f}"])
    (few, quick), (many, slow) = costs[0], costs[-1]
    verdict = "met" if slow / quick <= many / few else "MISSED"
    text = f"{many / few:.0f} times the points cost {slow / quick:.1f} times the time: {verdict}"
    title = f"Cost against size, simulated street; target: no worse than linear. {text}"
    return TextTable(["beams x columns", "points", "median (ms)"], rows, title)


def _times_ms(sweeps: Sequence[Sweep]) -> list[float]:
    estimator = make_method("online", preset("online"))
    times_ms = []
    for index in range(1, len(sweeps) - 1):
        start_s = time.perf_counter()
        estimator.estimate(SweepTriplet(*sweeps[index - 1 : index + 2]))
        times_ms.append((time.perf_counter() - start_s) * 1e3)
    return times_ms[3:]


if __name__ == "__main__":
    _print_digest()
