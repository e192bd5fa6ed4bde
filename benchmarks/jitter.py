# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What small changes of a drive do, which must not matter.

    python benchmarks/jitter.py [--seeds A B] [--workers N] [--cache DIR] [--document FILE]

Drives are KITTI 0005, if the shared data is there, and random worlds (see movers.py); those without
movers are left out. A mover of 20 points and more is found if half of them are called dynamic; it
flips if it is found in the changed drive only, or in the unchanged one only. Two sweeps: each
estimate starts from scratch.
"""

from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final

import numpy as np
from drives import TrueSweep, kept_world, real_sweeps
from frame import Table, make_parser, publish
from mover_kinds import mover_kinds
from movers import DURATION_S, KITTI, add_world_options, in_processes
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation
from world_scores import NUM_FIRST, scored

from mnsf_ros.sweeps.sweep import NANOSECONDS

Change = Callable[[TrueSweep, np.random.Generator], TrueSweep]
# Whether each mover of 20 points and more is found, by number of the estimate and object.
Verdicts = dict[tuple[int, int], bool]

_HOURS_NS: Final = 7 * 3600 * NANOSECONDS
_HEADER: Final = ("", "movers", "flips (%)", "EPE dynamic (m)", "two sweeps: flips (%)", "EPE (m)")


def _at(item: TrueSweep, stamp_ns: int) -> TrueSweep:
    sweep, truth = (replace(each, stamp_ns=stamp_ns) for each in (item.sweep, item.truth))
    return replace(item, sweep=sweep, truth=truth)


def _slower(factor: float) -> Change:
    return lambda item, _: _at(item, round(item.sweep.stamp_ns * factor))


def _late(item: TrueSweep, rng: np.random.Generator) -> TrueSweep:
    return _at(item, item.sweep.stamp_ns + int(rng.uniform(-5e5, 5e5)))


def _mounted(shift_m: Sequence[float] = (0, 0, 0), yaw_deg: float = 0.0) -> Change:
    """The sensor's frame is another one."""
    new_from_old = np.eye(4)
    new_from_old[:3, :3] = Rotation.from_euler("z", yaw_deg, degrees=True).as_matrix()
    new_from_old[:3, 3] = shift_m
    turn = new_from_old[:3, :3].T

    def changed(item: TrueSweep, _: np.random.Generator) -> TrueSweep:
        xyz = (item.sweep.xyz @ turn + shift_m).astype(np.float32)
        truth = replace(item.truth, flow=(item.truth.flow @ turn).astype(np.float32))
        pose = item.pose @ np.linalg.inv(new_from_old)
        return TrueSweep(replace(item.sweep, xyz=xyz), pose, truth)

    return changed


def _part(item: TrueSweep, rows: NDArray[np.int64]) -> TrueSweep:
    return replace(item, sweep=item.sweep.part(rows), truth=item.truth.of_points(rows))


def _shuffled(item: TrueSweep, rng: np.random.Generator) -> TrueSweep:
    return _part(item, rng.permutation(len(item.sweep)))


def _thinned(item: TrueSweep, rng: np.random.Generator) -> TrueSweep:
    return _part(item, np.flatnonzero(rng.random(len(item.sweep)) >= 0.01))


def _noisy(item: TrueSweep, rng: np.random.Generator) -> TrueSweep:
    noise_m = rng.normal(0.0, 0.001, item.sweep.xyz.shape).astype(np.float32)
    return replace(item, sweep=replace(item.sweep, xyz=item.sweep.xyz + noise_m))


_CHANGES: Final[dict[str, Change]] = {
    "none": lambda item, _: item,
    "intervals × 1.0005": _slower(1.0005),
    "intervals × 1.001": _slower(1.001),
    "intervals × .99": _slower(0.99),
    "intervals × 1.01": _slower(1.01),
    "stamps off by up to .5 ms": _late,
    "stamps later by 7 h": lambda item, _: _at(item, item.sweep.stamp_ns + _HOURS_NS),
    "shifted by (.13, .07) m": _mounted((0.13, 0.07, 0)),
    "turned by 1°": _mounted(yaw_deg=1),
    "turned by 37°": _mounted(yaw_deg=37),
    "points in another order": _shuffled,
    "1 % of points left out": _thinned,
    "1 mm of noise": _noisy,
}


def main() -> None:
    """Measures all changes of all drives, prints tables, and writes them into a document."""
    parser = make_parser(__doc__)
    add_world_options(parser, (705, 706))
    options = parser.parse_args()
    seeds = [None, *range(*options.seeds)]
    tables = in_processes(_table, [(seed, options.cache) for seed in seeds], options.workers)
    publish("jitter", (table for table in tables if table.rows), options.document)


def _table(seed: int | None, cache: Path) -> Table:
    """Of a world, or of KITTI."""
    if seed is None:
        return Table(KITTI, _HEADER, list(_rows(real_sweeps("kitti_0005"))))
    world = kept_world(seed, DURATION_S, "random", cache)
    return Table(f"World {seed}, {world.lidar}", _HEADER, list(_rows(world.sweeps)))


def _rows(sweeps: Sequence[TrueSweep]) -> Iterator[list[str]]:
    if not any(item.truth.dynamic.any() for item in sweeps):
        return
    unchanged: list[Verdicts] = []
    for name, change in _CHANGES.items():
        rng = np.random.default_rng(0)
        drive = [change(item, rng) for item in sweeps]
        changed = [_verdicts(drive, from_scratch=each) for each in (False, True)]
        unchanged = unchanged or [verdicts for verdicts, _ in changed]
        row = [name, str(len(unchanged[0]))]
        for before, (after, epe_m) in zip(unchanged, changed, strict=True):
            both = before.keys() & after.keys()
            flips = sum(before[key] != after[key] for key in both)
            row += [f"{100 * flips / max(len(both), 1):.1f}", f"{epe_m:.4f}"]
        yield row


def _verdicts(sweeps: Sequence[TrueSweep], *, from_scratch: bool) -> tuple[Verdicts, float]:
    """Verdicts of a drive, and the mean end point error of its dynamic points, in metres."""
    verdicts, errors_m = {}, []
    counted = range(NUM_FIRST, len(sweeps) - 1)
    for index, one in enumerate(scored("", sweeps, counted, from_scratch=from_scratch)):
        errors_m.append(one.errors_m[one.truth.dynamic])
        for own, _ in mover_kinds(one.truth):
            verdicts[index, int(one.truth.object_id[own[0]])] = bool(one.called[own].mean() >= 0.5)
    return verdicts, float(np.concatenate(errors_m).mean())


if __name__ == "__main__":
    main()
