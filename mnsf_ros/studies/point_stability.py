"""How much a result changes when a single point of the sweeps is another one.

The paper's theorem bounds the change of the loss by a term that falls with one over the number of
points. Measured is what the bound is a bound of: a method runs on sweeps of N points, then on the
same sweeps with one point replaced by another of the full sweep, from the same start weights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

SWEEPS: Final = ("current", "next", "previous")


@dataclass(frozen=True)
class Change:
    """What replacing one point did.

    Attributes:
        method: Name of the method.
        num_points: Points N of each sweep.
        sweep: In which sweep: current, next or previous.
        repeat: Number of the draw.
        flow_m: Mean length of the change of flow over the points that stayed, metres.
        loss_m: Change of the mean distance of those points to the full next sweep, metres.
    """

    method: str
    num_points: int
    sweep: str
    repeat: int
    flow_m: float
    loss_m: float


@dataclass(frozen=True)
class Slope:
    """A straight line through changes over numbers of points, both logarithmic.

    Attributes:
        slope: -1 is one over N.
        deviation: Its standard error; NaN with fewer than three numbers of points.
    """

    slope: float
    deviation: float


def changes(
    method: str,
    estimator: SceneFlowEstimator,
    triplet: SweepTriplet,
    sizes: Sequence[int],
    num_repeats: int,
    seed: int,
) -> Iterator[Change]:
    """Replaces points and yields what that does.

    Args:
        method: Name of the method.
        estimator: The method; the same triplet must give the same flow.
        triplet: The full sweeps.
        sizes: Numbers of points, each less than the smallest sweep has.
        num_repeats: So many draws of points for each size.
        seed: Of the draws, which are the same for all methods.

    Raises:
        EvaluationError: A sweep has too few points.
        MnsfError: An estimate fails.
    """
    _check_sizes(triplet, sizes)
    tree = cKDTree(triplet.next.kept_xyz)
    for size in sizes:
        for repeat in range(num_repeats):
            random = np.random.default_rng([seed, size, repeat])
            drawn = {name: _drawn(triplet, name, size, random) for name in SWEEPS}
            usual = {name: rows[:-1] for name, rows in drawn.items()}
            before = estimator.estimate(_part(triplet, usual)).flow
            for name in SWEEPS:
                # The last one drawn takes the place of the first.
                other = usual | {name: np.concatenate([drawn[name][-1:], usual[name][1:]])}
                after = estimator.estimate(_part(triplet, other)).flow
                xyz = triplet.current.kept_xyz[usual["current"]][1:]
                pair = (before[1:], after[1:])
                losses = [float(tree.query(xyz + flow)[0].mean()) for flow in pair]
                flow_m = float(np.linalg.norm(pair[1] - pair[0], axis=1).mean())
                yield Change(method, size, name, repeat, flow_m, abs(losses[1] - losses[0]))


def mean_changes(found: Sequence[Change], method: str, sweep: str, part: str) -> dict[int, float]:
    """Returns number of points to mean change over the draws.

    Args:
        found: Changes of any methods.
        method: Of which method.
        sweep: In which sweep.
        part: `flow_m` or `loss_m`.
    """
    values: dict[int, list[float]] = {}
    for change in found:
        if (change.method, change.sweep) == (method, sweep):
            values.setdefault(change.num_points, []).append(getattr(change, part))
    return {size: math.fsum(items) / len(items) for size, items in sorted(values.items())}


def fitted_slope(means: dict[int, float]) -> Slope:
    """Returns the slope of the logarithm of change over that of the number of points.

    Changes of exactly zero, as of a sweep that a method does not look at, have no logarithm and
    are left out; with fewer than two others there is no slope.
    """
    known = [(size, value) for size, value in means.items() if value > 0]
    if len(known) < 2:
        return Slope(math.nan, math.nan)
    x, y = np.log(np.array(known, dtype=np.float64)).T
    x = x - x.mean()
    slope = float((x * y).sum() / (x * x).sum())
    if len(known) < 3:
        return Slope(slope, math.nan)
    rest = y - y.mean() - slope * x
    return Slope(slope, float(np.sqrt((rest**2).sum() / (len(x) - 2) / (x * x).sum())))


def _check_sizes(triplet: SweepTriplet, sizes: Sequence[int]) -> None:
    """Says before the work whether each sweep has enough points."""
    for name in SWEEPS:
        number = len(_sweep(triplet, name))
        for size in sizes:
            if number <= size:
                raise EvaluationError(
                    f"sizes: got {size}, but the {name} sweep has {number} points, expected more"
                )


def _drawn(
    triplet: SweepTriplet, name: str, size: int, random: np.random.Generator
) -> NDArray[np.int64]:
    """Rows of so many points of a sweep, and one more."""
    return random.choice(len(_sweep(triplet, name)), size + 1, replace=False)


def _sweep(triplet: SweepTriplet, name: str) -> Sweep:
    sweep: Sweep | None = getattr(triplet, name)
    if sweep is None:
        raise EvaluationError(f"the triplet has no {name} sweep")
    return sweep if sweep.kept is None else _of_all_kept(sweep, sweep.kept_xyz)


def _of_all_kept(sweep: Sweep, xyz: NDArray[np.float32]) -> Sweep:
    """The sweep with these points only, whose flow is asked for."""
    kept = None if sweep.kept is None else np.ones(len(xyz), dtype=bool)
    return replace(sweep, xyz=xyz, kept=kept)


def _part(triplet: SweepTriplet, rows: dict[str, NDArray[np.int64]]) -> SweepTriplet:
    sweeps = ((_sweep(triplet, name), rows[name]) for name in SWEEPS)
    current, following, previous = (_of_all_kept(one, one.xyz[chosen]) for one, chosen in sweeps)
    return replace(triplet, current=current, next=following, previous=previous, earlier=())
