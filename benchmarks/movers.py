# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How well methods find and follow movers, against targets.

    python benchmarks/movers.py [--methods online,mnsf] [--half tuned] [--seeds A B] [--workers N]
        [--cache DIR] [--csv FILE] [--document FILE]

Runs over random worlds, and over consecutive sweeps of KITTI 0005 if the shared data is there (see
drives.py). All methods get the same sweeps; the first one has figures for each kind of lidar, the
others are compared with it. Constants were tuned on worlds below 1,000 and on the first half of
KITTI. A hundred worlds from 1,000 on are run once for a report, then the next hundred. The sweeps
of worlds are kept on disk, about 40 MB each: another program is compared on the same ones in half
the time.
"""

import argparse
import math
import multiprocessing
import os
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from itertools import chain
from pathlib import Path
from typing import Any, Final

import numpy as np
import pandas as pd
from drives import kept_world, real_sweeps
from frame import TARGET_HEADER, Table, Target, make_parser, publish
from mover_kinds import KINDS
from rich.progress import track
from world_scores import NUM_FIRST, WorldScore, scored, world_score

from mnsf_ros.evaluation.summary import summarize

KITTI: Final = "KITTI 0005"
DURATION_S: Final = 2.5
CACHE: Final = Path(tempfile.gettempdir()) / f"mnsf_worlds_{os.getuid()}"
# One world in so many is run a second time without anything that moves.
_STANDING_EVERY: Final = 5
_LIDARS: Final = ("16 beams", "32 beams", "64 beams", "128 beams", "solid state")
_ALL, _STANDING = "all", "standing"
# Figures of worlds: title, and whether more is better.
_MAIN: Final = {
    "recall": ("recall", True),
    "pedestrians": ("pedestrians", True),
    "false movers": ("false movers a sweep", False),
    "dynamic EPE": ("EPE dynamic (m)", False),
    "dynamic EPE, two sweeps": ("two sweeps", False),
    "cost": ("CPU (ms)", False),
}
_MORE: Final = {
    "found": ("movers found", True),
    "static EPE": ("EPE static (m)", False),
    "velocity": ("velocity (m/s)", False),
    "ego motion": ("ego motion (m)", False),
}
FIGURES: Final = _MAIN | _MORE
# Limit for further methods.
_RATIO: Final = "dynamic EPE over that of"
_MAX_RATIO: Final = 1.3
# A band of confidence with fewer points is not judged.
_MIN_BAND_POINTS: Final = 500


def main() -> None:
    """Measures KITTI and worlds, prints their tables, and writes them into a document."""
    parser = make_parser(__doc__)
    parser.add_argument("--half", choices=("tuned", "reported"), default="reported", help="KITTI")
    parser.add_argument("--methods", default="online", help="names with commas between")
    parser.add_argument("--csv", type=Path, metavar="FILE", help="write the figures of each world")
    add_world_options(parser, (0, 30))
    options = parser.parse_args()
    methods = options.methods.split(",")

    def measured() -> Iterator[Table]:
        yield from kitti_tables(options.half, methods)
        scores = world_scores(range(*options.seeds), methods, options.workers, options.cache)
        yield from world_tables(scores)
        if options.csv:
            figures(scores).to_csv(options.csv)

    publish("movers", measured(), options.document)


def add_world_options(parser: argparse.ArgumentParser, seeds: tuple[int, int]) -> None:
    """Adds `--seeds`, `--workers` and `--cache`."""
    chosen = parser.add_argument("--seeds", nargs=2, type=int, metavar=("A", "B"), default=seeds)
    chosen.help = f"worlds from A to B - 1 (default: {seeds[0]} {seeds[1]}; 0 1000: for tuning)"
    parser.add_argument("--workers", type=int, default=os.cpu_count(), help="processes")
    cache = parser.add_argument("--cache", type=Path, default=CACHE)
    cache.help = "of worlds (default: %(default)s)"


def kitti_tables(half: str, methods: Sequence[str]) -> Iterator[Table]:
    """Figures of the real drive, if it is there, and their targets."""
    kitti = real_sweeps("kitti_0005")
    if not kitti:
        return
    middle = len(kitti) // 2
    counted = range(NUM_FIRST, middle) if half == "tuned" else range(middle, len(kitti) - 1)
    kinds = (("", False), (", two sweeps", True))
    runs = {f"`{each}`{text}": (each, scratch) for each in methods for text, scratch in kinds}
    rows = [
        one.row
        for name, (each, scratch) in runs.items()
        for one in scored(name, kitti, counted, method=each, from_scratch=scratch)
    ]
    summary = summarize(rows, list(runs))
    columns = {
        "movers.recall": "recall",
        "movers.precision": "precision",
        "movers.ghosts_per_sweep": "false movers a sweep",
        "errors.dynamic.epe_m": "EPE dynamic (m)",
        "errors.static.epe_m": "EPE static (m)",
    }
    cells = [
        [str(name), *(f"{line[each]:.3f}" for each in columns)] for name, line in summary.iterrows()
    ]
    yield Table(f"{KITTI}, {half} half", ["", *columns.values()], cells)
    dynamic_m, static_m = (summary[f"errors.{part}.epe_m"] for part in ("dynamic", "static"))
    first, pairs, *further = runs
    targets = [
        Target(f"{KITTI}, {first}: dynamic EPE (m)", 0.04, dynamic_m[first]),
        Target(f"{KITTI}, {first}: static EPE (m)", 0.01, static_m[first]),
        Target(f"{KITTI}, {pairs}: dynamic EPE (m)", 0.045, dynamic_m[pairs]),
    ]
    for each in further[::2]:
        ratio = dynamic_m[each] / dynamic_m[first]
        targets.append(Target(f"{KITTI}, {each}: {_RATIO} {first}", _MAX_RATIO, ratio))
    cells = [each.row() for each in targets]
    yield Table("Targets, real drive", TARGET_HEADER, cells, is_detail=True)


def in_processes(
    work: Callable[..., Any], tasks: Sequence[tuple[Any, ...]], num_workers: int
) -> list[Any]:
    """Results of work on each of the tasks, in their order."""
    for name in ("OMP", "OPENBLAS", "NUMBA"):
        os.environ.setdefault(f"{name}_NUM_THREADS", "1")
    # Not fork: compiled loops may have threads.
    with ProcessPoolExecutor(num_workers, multiprocessing.get_context("spawn")) as pool:
        futures = [pool.submit(work, *task) for task in tasks]
        for _ in track(as_completed(futures), "worlds", total=len(futures), transient=True):
            pass
    return [future.result() for future in futures]


def world_scores(
    seeds: Sequence[int], methods: Sequence[str], num_workers: int, cache: Path
) -> list[WorldScore]:
    """Scores of each method in random worlds, and in some in which nothing moves."""
    tasks = [(seed, "random", methods, cache) for seed in seeds]
    tasks += [(seed, _STANDING, methods, cache) for seed in seeds[::_STANDING_EVERY]]
    return list(chain.from_iterable(in_processes(_scores, tasks, num_workers)))


def _scores(seed: int, scenario: str, methods: Sequence[str], cache: Path) -> list[WorldScore]:
    world = kept_world(seed, DURATION_S, scenario, cache)
    return [world_score(world, scenario, method) for method in methods]


def figures(scores: Sequence[WorldScore]) -> pd.DataFrame:
    """A line for each world: seed, scenario, lidar, all figures, and what was drawn."""
    names = ("seed", "scenario", "lidar", "text", "method")
    lines = [{name: getattr(one, name) for name in names} | one.figures for one in scores]
    return pd.DataFrame(lines).set_index("seed")


def world_tables(scores: Sequence[WorldScore]) -> Iterator[Table]:
    """Median and worst tenth for each kind of lidar, and targets; then methods side by side."""

    def chosen(method: str, scenario: str) -> list[WorldScore]:
        return [one for one in scores if (one.method, one.scenario) == (method, scenario)]

    by_method = {each: chosen(each, "random") for each in dict.fromkeys(o.method for o in scores)}
    first, *further = by_method
    moving = by_method[first]
    groups = {lidar: [one for one in moving if one.lidar == lidar] for lidar in _LIDARS}
    groups |= {_ALL: moving, _STANDING: chosen(first, _STANDING)}
    groups = {name: own for name, own in groups.items() if own}
    shown = dict(groups)
    for method in further:
        shown[f"{_ALL}, `{method}`"] = by_method[method]
        if _STANDING in groups:
            shown[f"{_STANDING}, `{method}`"] = chosen(method, _STANDING)
    seeds = [one.seed for one in moving]
    title = f"Random worlds, seeds {min(seeds)} to {max(seeds)}: median/worst tenth"
    header = ["", "worlds", *(text for text, _ in _MAIN.values()), "stops"]
    rows = [
        [name, str(len(own)), *_spreads(own, _MAIN), _stops(own)] for name, own in shown.items()
    ]
    yield Table(title, header, rows)
    header = ["", *(text for text, _ in _MORE.values()), "confidence off by", "from two sweeps"]
    rows = [[name, *_spreads(own, _MORE), *_off(own)] for name, own in shown.items()]
    yield Table("More of the worlds: median/worst tenth", header, rows, is_detail=True)
    yield _kind_table(by_method)
    if further:
        rows = [target.row() for target in _ratio_targets(by_method)]
        yield Table("Median over worlds", TARGET_HEADER, rows)
    rows = [target.row() for name, own in groups.items() for target in targets(name, own)]
    yield Table("Targets, random worlds", TARGET_HEADER, rows, is_detail=True)


def _kind_table(scores: Mapping[str, Sequence[WorldScore]]) -> Table:
    """Errors of each method for each kind of mover."""
    errors_m = {
        method: {kind: [m for one in own for m in one.errors_m.get(kind, ())] for kind in KINDS}
        for method, own in scores.items()
    }
    numbers = next(iter(errors_m.values()))
    rows = [
        [kind, str(len(numbers[kind])), *(f"{np.mean(own[kind]):.3f}" for own in errors_m.values())]
        for kind in KINDS
        if numbers[kind]
    ]
    title = "EPE (m) of movers by kind, mean over movers and sweeps"
    return Table(title, ["", "sightings", *(f"`{method}`" for method in scores)], rows)


def _ratio_targets(scores: Mapping[str, Sequence[WorldScore]]) -> Iterator[Target]:
    """Median error of the further methods over that of the first, and where they are better."""
    errors_m = {
        method: np.array([one.figures["dynamic EPE"] for one in own])
        for method, own in scores.items()
    }
    first, *further = errors_m
    # Worlds without movers have no error.
    count = np.count_nonzero(~np.isnan(errors_m[first]))
    for method in further:
        ratio = spread(scores[method], "dynamic EPE")[0] / spread(scores[first], "dynamic EPE")[0]
        number = np.count_nonzero(errors_m[method] < errors_m[first])
        text = f"{ratio:.2f}, better in {number} of {count} worlds"
        yield Target(f"`{method}`: {_RATIO} `{first}`", _MAX_RATIO, ratio, text=text)


def _spreads(scores: Sequence[WorldScore], names: Iterable[str]) -> list[str]:
    return [_spread_text(*spread(scores, name), 0 if name == "cost" else 3) for name in names]


def _spread_text(median: float, worst: float, decimals: int) -> str:
    return "" if math.isnan(median) else f"{median:.{decimals}f}/{worst:.{decimals}f}"


def _stops(scores: Sequence[WorldScore]) -> str:
    number, held, released = (total(scores, each) for each in ("stops", "held", "released"))
    return f"{held:.0f}/{number:.0f}, {released:.0f}/{number:.0f}" if number else ""


def _off(scores: Sequence[WorldScore]) -> list[str]:
    both = (deviation(scores, from_scratch=scratch) for scratch in (False, True))
    return ["" if math.isnan(each) else f"{each:.2f}" for each in both]


def spread(scores: Sequence[WorldScore], figure: str) -> tuple[float, float]:
    """Returns the median over worlds, and the limit of the worst tenth; NaN without any."""
    values = np.array([one.figures[figure] for one in scores])
    values = values[~np.isnan(values)]
    if len(values) == 0:
        return math.nan, math.nan
    worst = np.quantile(values, 0.1 if FIGURES[figure][1] else 0.9)
    return float(np.median(values)), float(worst)


def total(scores: Sequence[WorldScore], figure: str) -> float:
    """Returns the sum of a figure over worlds."""
    return sum(one.figures[figure] for one in scores)


def deviation(scores: Sequence[WorldScore], *, from_scratch: bool) -> float:
    """Returns the largest difference of confidence and deserved share of a band; NaN if none."""
    bands: dict[int, np.ndarray] = {}
    for one in scores:
        for (band, is_scratch), numbers in one.confidence.items():
            if is_scratch == from_scratch:
                bands[band] = bands.get(band, 0.0) + numbers
    off = (
        abs(said - close) / number
        for number, said, close in bands.values()
        if number >= _MIN_BAND_POINTS
    )
    return max(off, default=math.nan)


def targets(name: str, scores: Sequence[WorldScore]) -> Iterator[Target]:
    """Yields the targets of the worlds of one kind of lidar, of all, or of those that stand."""
    _, false_movers = spread(scores, "false movers")
    if name == _STANDING:
        yield Target(f"{name}: false movers a sweep, worst tenth", 0.0, false_movers)
        return
    yield Target(f"{name}: false movers a sweep, worst tenth", 0.1, false_movers)
    median, worst = spread(scores, "recall")
    recall = f"{name}: recall at .95 precision"
    yield Target(f"{recall}, median", 0.95, median, is_minimum=True)
    yield Target(f"{recall}, worst tenth", 0.85, worst, is_minimum=True)
    if name in ("64 beams", "128 beams"):
        found = spread(scores, "pedestrians")[0]
        yield Target(f"{name}: pedestrians to 30 m, median", 0.9, found, is_minimum=True)
    for text, scratch in (("", False), (", two sweeps", True)):
        off = deviation(scores, from_scratch=scratch)
        yield Target(f"{name}: largest deviation of confidence{text}", 0.05, off)
    if name == _ALL and (number := total(scores, "stops")):
        for part in ("held", "released"):
            share = total(scores, part) / number
            yield Target(f"vehicles that stop: {part}", 0.95, share, is_minimum=True)


if __name__ == "__main__":
    main()
