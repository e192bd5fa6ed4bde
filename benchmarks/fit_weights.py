# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fits the weights of the gate and of the confidence of `online`.

    python benchmarks/fit_weights.py [--sweeps N] [--seeds A B] [--cache DIR]

Runs `online` on the first half of KITTI and on random worlds, and on some of their sweeps from
scratch. Prints weights for mnsf_ros/online/gate.py (the gate) and
mnsf_ros/online/confidence.py, and the loss with these and with the current weights. A recording
counts by the root of its samples. movers.py shows how well the confidence holds on the other half
and on other worlds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from drives import TrueSweep, kept_world, real_sweeps, triplet_at
from frame import make_parser
from movers import CACHE, DURATION_S
from numpy.typing import NDArray
from scipy.optimize import minimize
from world_scores import NUM_FIRST

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.methods import make_method
from mnsf_ros.online.confidence import doubtful_features, moving_features, static_features
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.table import FITTED, ObjectTable
from mnsf_ros.presets import preset

_CLOSE_M: Final = 0.1
# An object counts by its points to this power.
_POWER: Final = 0.75
# Standing points of a sweep; neighbouring points say the same.
_MAX_STATIC: Final = 500
# Every so many sweeps an estimate from scratch is a sample, too.
_SCRATCH_EVERY: Final = 3
# Real objects are few. A mover that is found with a wrong motion may be found late.
_REAL_COUNT, _HARMFUL_COUNT = 3.0, 0.5
# Shorter motions to the next sweep are static for the gate, though people may be that slow.
_MIN_MOTION_M: Final = 0.02
_MIN_POINTS: Final = 5


@dataclass(frozen=True, eq=False)
class Samples:
    """K objects or points.

    Attributes:
        features: (K, F) features of the regression.
        share: (K,) share of right points, 0 to 1.
        counts: (K,) weight in the fit.
        said: (K,) probability with the current weights.
    """

    features: NDArray[np.float64]
    share: NDArray[np.float64]
    counts: NDArray[np.float64]
    said: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: list[Samples]) -> Samples:
        """Returns all parts in one."""
        names = ("features", "share", "counts", "said")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))

    def loss(self, probability: NDArray[np.float64]) -> float:
        """Returns the mean logarithmic loss of probabilities (K,)."""
        likely = np.clip(probability, 1e-6, 1 - 1e-6)
        losses = -self.share * np.log(likely) - (1 - self.share) * np.log(1 - likely)
        return float(np.average(losses, weights=self.counts))


# Name of a regression, to its samples of one estimate.
Sample = tuple[str, Samples]


def main() -> None:
    """Prints the weights."""
    parser = make_parser(__doc__, has_document=False)
    parser.add_argument("--sweeps", type=int, default=18, help="of each random world")
    parser.add_argument(
        "--cache", type=Path, default=CACHE, help="of worlds (default: %(default)s)"
    )
    parser.add_argument("--seeds", nargs=2, type=int, metavar=("A", "B"), default=(0, 30))
    options = parser.parse_args()
    for name, samples in _joined(range(*options.seeds), options.sweeps, options.cache).items():
        weights = _fitted(samples)
        losses = (samples.loss(said) for said in (samples.said, _logistic(samples, weights)))
        text = "{:.4f} with the current weights, {:.4f} with these".format(*losses)
        print(f"{name}: ({', '.join(f'{weight:.2f}' for weight in weights)}), loss {text}")


def _joined(seeds: Iterable[int], num_sweeps: int, cache: Path) -> dict[str, Samples]:
    found: dict[str, list[Samples]] = defaultdict(list)
    if kitti := real_sweeps("kitti_0005"):
        _add(found, kitti[: len(kitti) // 2 + 1], _REAL_COUNT)
    for seed in seeds:
        _add(found, kept_world(seed, DURATION_S, "random", cache).sweeps[:num_sweeps], 1.0)
    return {name: Samples.joined(parts) for name, parts in found.items()}


def _add(found: dict[str, list[Samples]], sweeps: list[TrueSweep], count: float) -> None:
    """Adds the samples of a recording, by the names of their regressions."""
    own: dict[str, list[Samples]] = defaultdict(list)
    estimator = make_method("online", preset("online"))
    for index in range(1, len(sweeps) - 1):
        triplet = triplet_at(sweeps, index)
        estimates = [estimator.estimate(triplet)]
        if index < NUM_FIRST:
            continue
        if index % _SCRATCH_EVERY == 0:
            estimates += [
                make_method("online", preset("online")).estimate(each)
                for each in (triplet, replace(triplet, previous=None))
            ]
        for estimate in estimates:
            for name, samples in _samples(estimate, sweeps[index], sweeps[index + 1]):
                own[name].append(samples)
    for name, parts in own.items():
        joined = Samples.joined(parts)
        scale = count / np.sqrt(max(joined.counts.sum(), 1.0))
        found[name].append(replace(joined, counts=scale * joined.counts))


def _samples(estimate: FlowEstimate, truth: TrueSweep, next_: TrueSweep) -> Iterator[Sample]:
    """Yields the samples of an estimate."""
    scene, table = estimate.reason_of.scene, estimate.reason_of.table
    rows = np.flatnonzero(truth.scored & estimate.kept)
    # With all parts, also of what moves.
    owners = scene.targets.near[0].current.objects()[rows]
    is_close = end_point_errors(estimate.flow[rows], truth.truth.flow[rows]) < _CLOSE_M
    said = estimate.over_ground.confidence[rows].astype(float)

    def of_objects(objects: ObjectPoints, features: NDArray[np.float64]) -> Samples:
        own = objects.rows_of(scene.current.num_objects)[owners]
        counts, close, sums = (
            np.bincount(own[own >= 0], values[own >= 0], len(objects))
            for values in (np.ones(len(own)), is_close, said)
        )
        seen = counts > 0
        shares, means = close[seen] / counts[seen], sums[seen] / counts[seen]
        return Samples(features[seen], shares, counts[seen] ** _POWER, means)

    movers, doubtful = table.movers, table.doubtful
    features = moving_features(movers.moving, movers.log_odds, movers.residual_rise)
    yield "moving", of_objects(movers.points, features)
    yield "doubtful", of_objects(doubtful.points, doubtful_features(doubtful.static))
    suspects = np.concatenate([movers.points.numbers, doubtful.points.numbers])
    are_suspects = np.isin(owners, suspects)
    static = np.flatnonzero(~are_suspects & ~estimate.over_ground.dynamic[rows])
    static = static[:: max(1, len(static) // _MAX_STATIC)]
    features = static_features(truth.sweep.xyz[rows[static]])
    ones = np.ones(len(static))
    yield "static", Samples(features, is_close[static].astype(float), ones, said[static])
    fitted = table.select(np.flatnonzero([verdict in FITTED for verdict in table.verdicts]))
    yield "gate", _gate_samples(fitted, owners, _true_motion(truth, next_)[rows])


def _true_motion(truth: TrueSweep, next_: TrueSweep) -> NDArray[np.float64]:
    """(N, 3) metres to the next sweep over ground, in the axes of the current one."""
    next_from_current = np.linalg.inv(next_.pose) @ truth.pose
    own = truth.truth.flow - rigid_flow(truth.sweep.xyz, next_from_current)
    motion: NDArray[np.float64] = own @ next_from_current[:3, :3]
    return motion


def _gate_samples(
    fitted: ObjectTable, owners: NDArray[np.int64], true_motion: NDArray[np.float64]
) -> Samples:
    """One sample for each object: whether it moves as it was fitted."""
    features, motions = fitted.evidence, fitted.moving.motions
    shares, counts = np.zeros(len(features)), np.zeros(len(features))
    for row, number in enumerate(fitted.points.numbers):
        own = true_motion[owners == number]
        if len(own) < _MIN_POINTS:
            continue
        motion = own.mean(axis=0)
        moves = (np.linalg.norm(own, axis=1) > _MIN_MOTION_M).mean()
        error, length = np.linalg.norm(motions[row] - motion), np.linalg.norm(motion)
        if moves > 0.5 and error < 0.05 + 0.15 * length:
            shares[row], counts[row] = 1.0, 1.0
        elif moves > 0.5 and error > max(0.3, length):
            counts[row] = _HARMFUL_COUNT
        elif moves < 0.1:
            counts[row] = 1.0
    kept = counts > 0
    said = 1 / (1 + np.exp(-fitted.log_odds[kept]))
    return Samples(features[kept], shares[kept], counts[kept], said)


def _fitted(samples: Samples) -> NDArray[np.float64]:
    """Weights (F,) of a logistic regression with a small penalty; the first one is the constant."""
    scale = np.maximum(samples.features.std(axis=0), 1e-9)
    scale[0] = 1.0
    features = samples.features / scale

    def loss(weights: NDArray[np.float64]) -> float:
        scores = features @ weights
        losses = np.logaddexp(0, scores) - samples.share * scores
        penalty = 1e-3 * float((weights[1:] ** 2).sum())
        return float(np.average(losses, weights=samples.counts)) + penalty

    return np.asarray(minimize(loss, np.zeros(len(scale))).x / scale, np.float64)


def _logistic(samples: Samples, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    probability: NDArray[np.float64] = 1 / (1 + np.exp(-samples.features @ weights))
    return probability


if __name__ == "__main__":
    main()
