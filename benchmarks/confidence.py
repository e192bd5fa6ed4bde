"""Fits the confidence of the online method to its errors, and shows how well it holds.

    python benchmarks/confidence.py

Runs the online preset on simulated streets and, where it is at hand, on KITTI 0005 (see
online_recordings.py). Even sweeps are fitted to, odd ones are checked. Prints the numbers for
mnsf_ros/objects/confidence.py, then, for ranges of the confidence as it is now, how many points
are indeed less than 0.1 m off.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import pairwise
from typing import Final
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from online_recordings import TrueSweep, real_sweeps, simulated_sweeps
from rich.console import Console
from scipy.optimize import minimize

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.methods import make_method
from mnsf_ros.objects import confidence, scene
from mnsf_ros.objects.motion_fusion import JudgedMotions
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.sweeps.sweep import SweepTriplet

_CLOSE_M: Final = 0.1
_EDGES: Final = (0, 0.2, 0.4, 0.6, 0.8, 0.9, 0.95, 0.98, 1.0001)
# Points of one sweep that are looked at; neighbors say the same.
_MAX_POINTS: Final = 4000
# So many sweeps of a recording have no past yet. Every third one is taken as one of two, too.
_NUM_FIRST: Final = 3
_PAIR_EVERY: Final = 3

_KINDS: Final = ("moving", "doubtful", "standing")

Samples = dict[str, NDArray[np.float64]]


def main() -> None:
    """Fits, and shows the table."""
    raw = argparse.RawDescriptionHelpFormatter
    argparse.ArgumentParser(description=__doc__, formatter_class=raw).parse_args()
    recordings = [
        simulated_sweeps(seed, 16, scenario=name)
        for name in ("street", "street_that_hurts")
        for seed in range(3)
    ]
    kitti = real_sweeps("kitti_0005")
    samples = list(_samples([*recordings, kitti] if kitti else recordings))
    console = Console(width=120)
    for name in _KINDS:
        fitted = [each for number, each in enumerate(samples) if number % 2 == 0]
        features, is_close = (
            np.concatenate([each[key] for each in fitted]) for key in (name, f"{name} close")
        )
        weights = ", ".join(f"{weight:.2f}" for weight in _fit(features, is_close))
        console.print(f"{name}: ({weights}), from {len(features)} points")
    checked = [each for number, each in enumerate(samples) if number % 2 == 1]
    console.print(_calibration(checked))


def _samples(recordings: list[list[TrueSweep]]) -> Iterator[Samples]:
    """Of each sweep with all that was before, and of some sweeps with the next one only."""
    for sweeps in recordings:
        estimator = make_method("online", preset("online"))
        for index in range(1, len(sweeps) - 1):
            previous, *pair = (item.sweep for item in sweeps[index - 1 : index + 2])
            sample = _sample(sweeps[index], estimator, SweepTriplet(previous, *pair))
            if index > _NUM_FIRST:
                yield sample
            if index % _PAIR_EVERY == 0:
                alone = make_method("online", preset("online"))
                yield _sample(sweeps[index], alone, SweepTriplet(None, *pair))


class _Recorder:
    """Takes the place of a function of confidence: notes features, numbers the objects."""

    def __init__(self, kind: str) -> None:
        self._features_of = getattr(confidence, f"{kind}_features")
        self._confidence_of = getattr(confidence, f"{kind}_confidence")
        # Beyond any confidence, so that the points of an object can be told from the result.
        self._first = {"moving": 10, "doubtful": 10_000}[kind]

    def __call__(
        self, objects: ObjectPoints, judged: JudgedMotions, *more: NDArray[np.float64]
    ) -> NDArray[np.float32]:
        self.features = self._features_of(objects, judged, *more)
        self.known = self._confidence_of(objects, judged, *more)
        return np.arange(len(objects), dtype=np.float32) + self._first

    def rows(self, values: NDArray[np.float32]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
        """Which of the points' values are of these objects, and of which."""
        is_own = (values >= self._first) & (values < self._first + len(self.known))
        return is_own, (values[is_own] - self._first).astype(int)


def _sample(truth: TrueSweep, estimator: SceneFlowEstimator, triplet: SweepTriplet) -> Samples:
    recorders = {kind: _Recorder(kind) for kind in ("moving", "doubtful")}
    with ExitStack() as stack:
        for kind, recorder in recorders.items():
            stack.enter_context(patch.object(scene, f"{kind}_confidence", recorder))
        estimate = estimator.estimate(triplet)
    rows = np.flatnonzero(truth.scored & estimate.kept)
    rows = rows[:: max(1, len(rows) // _MAX_POINTS)]
    is_close = end_point_errors(estimate.flow[rows], truth.flow[rows]) < _CLOSE_M
    values = estimate.over_ground.confidence[rows]
    is_standing = values <= 1
    sample = {
        "standing": confidence.standing_features(truth.sweep.xyz[rows[is_standing]]),
        "standing close": is_close[is_standing],
        "standing confidence": values[is_standing],
    }
    for kind, recorder in recorders.items():
        is_own, owners = recorder.rows(values)
        sample |= {
            kind: recorder.features[owners],
            f"{kind} close": is_close[is_own],
            f"{kind} confidence": recorder.known[owners],
        }
    return sample


def _fit(features: NDArray[np.float64], is_close: NDArray[np.bool_]) -> NDArray[np.float64]:
    sign = np.where(is_close, 1.0, -1.0)

    def loss(weights: NDArray[np.float64]) -> float:
        penalty = 1e-4 * float((weights**2).sum())
        return float(np.logaddexp(0, -sign * (features @ weights)).mean()) + penalty

    weights: NDArray[np.float64] = minimize(loss, np.zeros(features.shape[1])).x
    return weights


def _calibration(samples: list[Samples]) -> TextTable:
    rows = []
    for name in _KINDS:
        said = np.concatenate([each[f"{name} confidence"] for each in samples])
        is_close = np.concatenate([each[f"{name} close"] for each in samples])
        for low, high in pairwise(_EDGES):
            inside = (said >= low) & (said < high)
            if inside.any():
                counted = f"{np.count_nonzero(inside):,}"
                mean, share = said[inside].mean(), is_close[inside].mean()
                rows.append(
                    [f"{name}, {low:g} to {min(high, 1):g}", f"{mean:.2f}", f"{share:.2f}", counted]
                )
    header = ["confidence", "mean", "less than 0.1 m off", "points"]
    return TextTable(header, rows, "Confidence and share of points that deserve it, odd sweeps")


if __name__ == "__main__":
    main()
