"""How well movers are found and followed: points, objects, ghosts, confidence, CPU time.

    python benchmarks/movers.py [--half tuned reported] [--sweeps N]

Runs the online preset over consecutive sweeps of KITTI 0005, where it is at hand (see
online_recordings.py), and of simulated streets, usual and hard ones. Constants are tuned on the
first half of KITTI and on some seeds; the other half is reported.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from typing import Final

import numpy as np
from mover_scores import MOVER_CLASSES, MoverScores
from online_recordings import TrueSweep, real_sweeps, simulated_sweeps
from rich.console import Console

from mnsf_ros.evaluation.tables import TextTable
from mnsf_ros.methods import make_method
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import SweepTriplet

KITTI: Final = "KITTI 0005"
PAIRS: Final = "KITTI 0005, two sweeps"
HARD: Final = "hard streets"
USUAL: Final = "usual streets"
# Half to group of recordings to seeds.
SEEDS: Final = {
    "tuned": {HARD: (0, 1, 2), USUAL: (0,)},
    "reported": {HARD: (3, 4, 5), USUAL: (3,)},
}
_SCENARIOS: Final = {HARD: "street_that_hurts", USUAL: "street"}
# The first sweeps have no past and are not scored.
_NUM_FIRST: Final = 3

Scores = dict[str, MoverScores]


def main() -> None:
    """Measures the halves asked for and prints their tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--half", nargs="+", choices=SEEDS, default=list(SEEDS))
    parser.add_argument("--sweeps", type=int, default=24, help="of each simulated street")
    options = parser.parse_args()
    console = Console(width=120)
    times_ms: list[float] = []
    for half in options.half:
        scores: Scores = {}
        for group, name, sweeps, counted in recordings(half, options.sweeps):
            score = scores.setdefault(group, MoverScores())
            times_ms += run(score, name, sweeps, counted, are_pairs=group == PAIRS)
        for table in tables(half, scores):
            console.print(table)
    console.print(f"CPU time of an estimate: {np.median(times_ms):.0f} ms (median)")


def recordings(half: str, num_sweeps: int) -> Iterator[tuple[str, str, list[TrueSweep], range]]:
    """Group, name, sweeps, and the numbers of those that count."""
    kitti = real_sweeps("kitti_0005")
    if kitti:
        middle = len(kitti) // 2
        first, last = (_NUM_FIRST, middle) if half == "tuned" else (middle, len(kitti) - 1)
        for group in (KITTI, PAIRS):
            yield group, group, kitti, range(first, last)
    for group, seeds in SEEDS[half].items():
        for seed in seeds:
            sweeps = simulated_sweeps(seed, num_sweeps, scenario=_SCENARIOS[group])
            yield group, f"{group} {seed}", sweeps, range(_NUM_FIRST, len(sweeps) - 1)


def run(
    score: MoverScores, name: str, sweeps: list[TrueSweep], counted: range, *, are_pairs: bool
) -> Iterator[float]:
    """Runs over a recording, adds to the score, yields the CPU time of each estimate in ms."""
    estimator = make_method("online", preset("online"))
    for index in range(counted[0] if are_pairs else 1, counted[-1] + 1):
        previous, current, next_ = (each.sweep for each in sweeps[index - 1 : index + 2])
        if are_pairs:
            estimator, previous = make_method("online", preset("online")), None
        start_s = time.process_time()
        estimate = estimator.estimate(SweepTriplet(previous, current, next_))
        elapsed_ms = (time.process_time() - start_s) * 1e3
        if index in counted:
            score.add(name, index, sweeps[index], sweeps[index + 1], estimate)
            if not are_pairs:
                yield elapsed_ms


def tables(half: str, scores: Scores) -> Iterator[TextTable]:
    """Points, objects, confidence."""
    rows = [
        [
            group,
            f"{score.epe_m('dynamic'):.3f}",
            f"{score.epe_m('static'):.4f}",
            f"{score.precision:.3f}",
            f"{score.recall:.3f}",
            f"{score.ghosts_per_sweep:.2f}",
        ]
        for group, score in scores.items()
    ]
    header = ["", "EPE dynamic (m)", "EPE static (m)", "precision", "recall", "ghosts a sweep"]
    yield TextTable(header, rows, f"Points called moving, {half} half")
    rows = []
    for group, score in scores.items():
        for each in MOVER_CLASSES:
            share, number = score.found_share(each)
            if number:
                found, flicker = f"{share:.1%}", f"{score.flicker(each):.1%}"
                delay = f"{score.delay(each):.1f}"
                rows.append([f"{group}: {each.name}", found, flicker, delay, str(number)])
    header = ["movers of 20 points and more", "found", "flicker", "delay (sweeps)", "mover-sweeps"]
    yield TextTable(header, rows, f"Objects, {half} half")
    rows = [
        [group, f"{low:g}", f"{mean:.2f}", f"{share:.2f}", f"{number:,}"]
        for group, score in scores.items()
        for mean, share, low, number in score.calibration()
    ]
    header = ["", "from", "mean confidence", "less than 0.1 m off", "points"]
    yield TextTable(header, rows, f"Confidence of points called moving, {half} half")


if __name__ == "__main__":
    main()
