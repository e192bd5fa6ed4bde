# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fits the weights of the gate and of the confidence of `online`.

    python benchmarks/fit_weights.py [--sweeps N] [--seeds A B]

Runs `online` on the first half of KITTI and on random worlds, and on some of their sweeps from
scratch. Prints weights for mnsf_ros/objects/evidence.py (the gate, with and without older sweeps;
there the last weight without them is not fitted) and mnsf_ros/objects/confidence.py, and the loss
with these and with the current weights. movers.py shows how well the confidence holds on the other
half and on other worlds.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Final
from unittest.mock import patch

import numpy as np
from drives import TrueSweep, random_world, real_sweeps
from frame import make_parser
from movers import KITTI
from numpy.typing import NDArray
from scipy.optimize import minimize
from world_scores import NUM_FIRST

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.methods import make_method
from mnsf_ros.objects import confidence, object_flow, scene
from mnsf_ros.objects.evidence import moving_scores
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import SweepTriplet

_CLOSE_M: Final = 0.1
# An object counts by its points to this power.
_POWER: Final = 0.75
# Standing points of a sweep; neighbouring points say the same.
_MAX_STANDING: Final = 500
# Every so many sweeps an estimate from scratch is a sample, too.
_SCRATCH_EVERY: Final = 3
# Real objects are few. A mover that is found with a wrong motion may be found late.
_REAL_COUNT, _HARMFUL_COUNT = 3.0, 0.5
# Shorter motions to the next sweep are static for the gate, though people may be that slow.
_MIN_MOTION_M: Final = 0.02
_MIN_POINTS: Final = 5
# Confidence of these numbers marks the points of an object in the estimate.
_MARKS: Final = {"moving": 10, "doubtful": 10_000}


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
    parser.add_argument("--seeds", nargs=2, type=int, metavar=("A", "B"), default=(0, 30))
    options = parser.parse_args()
    for name, samples in _joined(options.sweeps, range(*options.seeds)).items():
        weights = _fitted(samples)
        losses = (samples.loss(said) for said in (samples.said, _logistic(samples, weights)))
        text = "{:.4f} with the current weights, {:.4f} with these".format(*losses)
        print(f"{name}: ({', '.join(f'{weight:.2f}' for weight in weights)}), loss {text}")


def _recordings(num_sweeps: int, seeds: Iterable[int]) -> Iterator[tuple[str, list[TrueSweep]]]:
    """Yields the first half of KITTI, if it is there, and random worlds."""
    if kitti := real_sweeps("kitti_0005"):
        yield KITTI, kitti[: len(kitti) // 2 + 1]
    for seed in seeds:
        yield "worlds", random_world(seed, num_sweeps).sweeps


def _joined(num_sweeps: int, seeds: Iterable[int]) -> dict[str, Samples]:
    found: dict[str, list[Samples]] = defaultdict(list)
    for group, sweeps in _recordings(num_sweeps, seeds):
        counted = range(NUM_FIRST, len(sweeps) - 1)
        estimator = make_method("online", preset("online"))
        for index in range(1, counted[-1] + 1):
            previous, *pair = (item.sweep for item in sweeps[index - 1 : index + 2])
            runs = [(estimator, previous)]
            if index % _SCRATCH_EVERY == 0:
                runs += [
                    (make_method("online", preset("online")), each) for each in (None, previous)
                ]
            for run, before in runs:
                truth = sweeps[index], sweeps[index + 1]
                for name, samples in _samples(run, SweepTriplet(before, *pair), *truth, group):
                    if index in counted:
                        found[name].append(samples)
    return {name: Samples.joined(parts) for name, parts in found.items()}


class _Recorder:
    """Takes the place of a function of `confidence`: keeps the features, numbers the objects."""

    def __init__(self, kind: str) -> None:
        self._features_of: Callable[..., NDArray[np.float64]] = getattr(
            confidence, f"{kind}_features"
        )
        self._confidence_of: Callable[..., NDArray[np.float32]] = getattr(
            confidence, f"{kind}_confidence"
        )
        self._first = _MARKS[kind]

    def __call__(self, objects: Suspects, *more: object) -> NDArray[np.float32]:
        self._features = self._features_of(objects, *more)
        self._said = self._confidence_of(objects, *more)
        return np.arange(len(objects), dtype=np.float32) + self._first

    def samples(self, marks: NDArray[np.float32], is_close: NDArray[np.bool_]) -> Samples:
        """Returns one sample for each object, from the marks of points and their errors."""
        is_own = (marks >= self._first) & (marks < self._first + len(self._said))
        owners = (marks[is_own] - self._first).astype(int)
        counts = np.bincount(owners, minlength=len(self._said)).astype(float)
        sums = np.bincount(owners, is_close[is_own], len(self._said))
        seen = counts > 0
        shares, said = sums[seen] / counts[seen], self._said[seen].astype(float)
        return Samples(self._features[seen], shares, counts[seen] ** _POWER, said)


def _samples(
    estimator: SceneFlowEstimator,
    triplet: SweepTriplet,
    truth: TrueSweep,
    next_: TrueSweep,
    group: str,
) -> Iterator[Sample]:
    """Runs one estimate and yields its samples."""
    recorders = {kind: _Recorder(kind) for kind in _MARKS}
    notes: list[tuple[Suspects, JudgedMotions, NDArray[np.float64]]] = []
    evidence_of = object_flow.evidence

    def noted(suspects: Suspects, moving: JudgedMotions, *more: object) -> NDArray[np.float64]:
        notes.append((suspects, moving, evidence_of(suspects, moving, *more)))
        return notes[-1][2]

    with ExitStack() as stack:
        stack.enter_context(patch.object(object_flow, "evidence", noted))
        for kind, recorder in recorders.items():
            stack.enter_context(patch.object(scene, f"{kind}_confidence", recorder))
        estimate = estimator.estimate(triplet)
    rows = np.flatnonzero(truth.scored & estimate.kept)
    is_close = end_point_errors(estimate.flow[rows], truth.flow[rows]) < _CLOSE_M
    marks = estimate.over_ground.confidence[rows]
    yield from ((kind, each.samples(marks, is_close)) for kind, each in recorders.items())
    standing = np.flatnonzero(marks <= 1)
    standing = standing[:: max(1, len(standing) // _MAX_STANDING)]
    features = confidence.standing_features(truth.sweep.xyz[rows[standing]])
    shares, said = is_close[standing].astype(float), marks[standing].astype(float)
    yield "standing", Samples(features, shares, np.ones(len(standing)), said)
    true_motion = _true_motion(truth, next_)
    for suspects, moving, features in notes:
        name = "gate with past" if suspects.standing.past.shape[1] else "gate without past"
        counts = _REAL_COUNT if group == KITTI else 1.0
        yield (
            name,
            _gate_samples(
                (suspects, moving, features), estimate, truth.scored, true_motion, counts
            ),
        )


def _true_motion(truth: TrueSweep, next_: TrueSweep) -> NDArray[np.float64]:
    """(N, 3) metres to the next sweep over ground, in the axes of the current one."""
    next_from_current = np.linalg.inv(next_.pose) @ truth.pose
    own = truth.flow - rigid_flow(truth.sweep.xyz, next_from_current)
    motion: NDArray[np.float64] = own @ next_from_current[:3, :3]
    return motion


def _gate_samples(
    note: tuple[Suspects, JudgedMotions, NDArray[np.float64]],
    estimate: FlowEstimate,
    scored: NDArray[np.bool_],
    true_motion: NDArray[np.float64],
    count: float,
) -> Samples:
    """One sample for each object: whether it moves as it was fitted."""
    suspects, moving, features = note
    owners = estimate.reason_of.scene.current.objects()
    shares, counts = np.zeros(len(features)), np.zeros(len(features))
    for row, number in enumerate(suspects.objects.numbers):
        own = (owners == number) & scored
        if np.count_nonzero(own) < _MIN_POINTS:
            continue
        motion = true_motion[own].mean(axis=0)
        moves = (np.linalg.norm(true_motion[own], axis=1) > _MIN_MOTION_M).mean()
        error, length = np.linalg.norm(moving.motions[row] - motion), np.linalg.norm(motion)
        if moves > 0.5 and error < 0.05 + 0.15 * length:
            shares[row], counts[row] = 1.0, count
        elif moves > 0.5 and error > max(0.3, length):
            counts[row] = _HARMFUL_COUNT * count
        elif moves < 0.1:
            counts[row] = count
    kept = counts > 0
    said = 1 / (1 + np.exp(-moving_scores(features[kept])))
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

    weights: NDArray[np.float64] = minimize(loss, np.zeros(len(scale))).x / scale
    return weights


def _logistic(samples: Samples, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    probability: NDArray[np.float64] = 1 / (1 + np.exp(-samples.features @ weights))
    return probability


if __name__ == "__main__":
    main()
