# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fits how likely objects move to evidence for it: the numbers of mnsf_ros/objects/evidence.py.

    python benchmarks/evidence.py [--seeds N ...]

Runs the online preset on simulated streets and, where it is at hand, on the first half of KITTI
0005 (see online_recordings.py), and some sweeps with two or three sweeps only. Prints the weights
of two logistic regressions, and how many static objects pass and movers are kept at some limits.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Final
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from online_recordings import TrueSweep, real_sweeps, simulated_sweeps
from scipy.optimize import minimize

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.geometry.rigid_motion import rigid_flow
from mnsf_ros.methods import make_method
from mnsf_ros.objects import object_flow
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.presets import preset
from mnsf_ros.sweeps.sweep import SweepTriplet

_NUM_SWEEPS: Final = 24
_EVERY: Final = 3
# Real objects are few, and count more. So do static ones: false movers are worse than late ones.
_REAL_WEIGHT: Final = 3.0
_STATIC_WEIGHT: Final = 1.5
# What moves by less than this to the next sweep is static, though a person may be slower than what
# is called dynamic.
_MIN_MOTION_M: Final = 0.02
_MIN_POINTS: Final = 5
# Scenarios of two seeds only.
_ONCE: Final = ("street", "standing", "slow_walkers", "alley", "bus", "crossing", "lorry")

Sample = tuple[NDArray[np.float64], NDArray[np.bool_], NDArray[np.float64]]


def main() -> None:
    """Fits with and without older sweeps."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--seeds", type=int, nargs="+", default=[0, 1, 2, 10, 11])
    samples = list(_samples(parser.parse_args().seeds))
    for number in sorted({features.shape[1] for features, _, _ in samples}):
        own = [sample for sample in samples if sample[0].shape[1] == number]
        _show(*(np.concatenate(parts) for parts in zip(*own, strict=True)))


def _samples(seeds: list[int]) -> Iterator[Sample]:
    streets = [("street_that_hurts", seed) for seed in seeds]
    streets += [(scenario, seed) for scenario in _ONCE for seed in seeds[:2]]
    for scenario, seed in streets:
        yield from _of_recording(simulated_sweeps(seed, _NUM_SWEEPS, scenario=scenario), 1.0)
    kitti = real_sweeps("kitti_0005")
    yield from _of_recording(kitti[: len(kitti) // 2], _REAL_WEIGHT)


def _of_recording(sweeps: list[TrueSweep], weight: float) -> Iterator[Sample]:
    estimator = make_method("online", preset("online"))
    for index in range(1, len(sweeps) - 1):
        previous, *pair = (item.sweep for item in sweeps[index - 1 : index + 2])
        truth = sweeps[index], sweeps[index + 1]
        yield from _of_estimate(estimator, SweepTriplet(previous, *pair), *truth, weight)
        for before in (None, previous) if index % _EVERY == 0 else ():
            fresh = make_method("online", preset("online"))
            yield from _of_estimate(fresh, SweepTriplet(before, *pair), *truth, weight)


def _of_estimate(
    estimator: SceneFlowEstimator,
    triplet: SweepTriplet,
    truth: TrueSweep,
    next_: TrueSweep,
    weight: float,
) -> Iterator[Sample]:
    """The evidence of each object, whether it moves as found, and how much it counts."""
    notes: list[tuple[Suspects, JudgedMotions, NDArray[np.float64]]] = []

    def noted(*arguments: object) -> NDArray[np.float64]:
        features = true_evidence(*arguments)
        notes.append((*arguments[:2], features))
        return features

    true_evidence = object_flow.evidence
    with patch.object(object_flow, "evidence", noted):
        estimate = estimator.estimate(triplet)
    ((suspects, moving, features),) = notes
    next_from_current = np.linalg.inv(next_.pose) @ truth.pose
    ego_flow = rigid_flow(triplet.current.xyz, next_from_current)
    true_motion = (truth.flow - ego_flow) @ next_from_current[:3, :3]
    owners = estimate.reason_of.current.objects()
    for row, number in enumerate(suspects.objects.numbers):
        own = (owners == number) & truth.scored
        if np.count_nonzero(own) < _MIN_POINTS:
            continue
        motion = true_motion[own].mean(axis=0)
        share = (np.linalg.norm(true_motion[own], axis=1) > _MIN_MOTION_M).mean()
        error, length = np.linalg.norm(moving.motions[row] - motion), np.linalg.norm(motion)
        is_right = share > 0.5 and error < 0.05 + 0.15 * length
        # A mover with a motion worse than none counts half; others that are not right, nothing.
        is_harmful = share > 0.5 and error > max(0.3, length)
        is_static = share < 0.1
        if is_static or is_right or is_harmful:
            counts = weight * (0.5 if is_harmful else _STATIC_WEIGHT if is_static else 1.0)
            yield features[row : row + 1], np.array([is_right]), np.array([counts])


def _show(
    features: NDArray[np.float64], is_right: NDArray[np.bool_], counts: NDArray[np.float64]
) -> None:
    scale = np.maximum(features.std(axis=0), 1e-9)
    scale[0] = 1.0
    scaled, sign = features / scale, np.where(is_right, 1.0, -1.0)

    def loss(weights: NDArray[np.float64]) -> float:
        penalty = 2e-3 * float((weights[1:] ** 2).sum())
        return float((counts * np.logaddexp(0, -sign * (scaled @ weights))).mean()) + penalty

    weights = minimize(loss, np.zeros(len(scale))).x / scale
    print(f"{len(features)} objects: ({', '.join(f'{weight:.2f}' for weight in weights)})")
    for limit in (0.3, 0.5, 0.7):
        passes = features @ weights > np.log(limit / (1 - limit))
        static, kept = np.count_nonzero(passes & ~is_right), passes[is_right].mean()
        print(f"  above {limit:g}: {static} that should not, {kept:.1%} of those that should")


if __name__ == "__main__":
    main()
