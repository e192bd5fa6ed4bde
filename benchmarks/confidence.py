# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Fits the confidence of the online method to its errors, and shows how well it holds.

    python benchmarks/confidence.py [--sweeps N] [--document FILE]

Runs the online preset on the recordings of movers.py, and on some of their sweeps with the next one
only. Those of the tuned half are fitted to: prints the numbers for mnsf_ros/objects/confidence.py.
Those of the reported half are checked: for ranges of the confidence as it is now, how many points
are indeed less than 0.1 m off. `--document` writes this table into a document.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import pairwise
from typing import Final
from unittest.mock import patch

import numpy as np
from marked_section import add_document_option, replace_section
from movers import KITTI, recordings
from numpy.typing import NDArray
from online_recordings import TrueSweep
from rich.console import Console
from scipy.optimize import minimize

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.methods import make_method
from mnsf_ros.objects import confidence, scene
from mnsf_ros.objects.suspects import Suspects
from mnsf_ros.presets import preset
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.simulation.settings import SCENARIOS
from mnsf_ros.sweeps.sweep import SweepTriplet

_CLOSE_M: Final = 0.1
_EDGES: Final = (0, 0.5, 0.8, 0.9, 0.95, 0.98, 1.0001)
# An object counts by its points to this power.
_POWER: Final = 0.75
# Static points of one sweep that are looked at; neighbours say the same.
_MAX_STANDING: Final = 500
# Every fourth sweep is taken as one of two, too.
_PAIR_EVERY: Final = 4
_MOVING: Final = "moving"
_KINDS: Final = (_MOVING, "doubtful", "standing")


@dataclass(frozen=True, eq=False)
class Samples:
    """K objects or points.

    Attributes:
        features: (K, F) what their confidence depends on.
        close: (K,) share of their points with less than 0.1 m of error.
        counts: (K,) their points.
        said: (K,) their confidence as it is now.
    """

    features: NDArray[np.float64]
    close: NDArray[np.float64]
    counts: NDArray[np.float64]
    said: NDArray[np.float64]

    @classmethod
    def joined(cls, parts: list[Samples]) -> Samples:
        """All in one."""
        names = ("features", "close", "counts", "said")
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


# Of one estimate: whether it is of two sweeps only, and the samples of each kind.
Sample = tuple[bool, dict[str, Samples]]


def main() -> None:
    """Fits, and shows the table."""
    raw = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=raw)
    parser.add_argument("--sweeps", type=int, default=18, help="of each simulated street")
    add_document_option(parser)
    options = parser.parse_args()
    console = Console(width=120)
    fitted = list(_samples("tuned", options.sweeps))
    for kind in _KINDS:
        samples = Samples.joined([of_kind[kind] for _, of_kind in fitted])
        weights = ", ".join(f"{weight:.2f}" for weight in _fit(samples))
        console.print(f"{kind}: ({weights}), from {samples.counts.sum():.0f} points")
    table = _calibration(list(_samples("reported", options.sweeps)))
    console.print(table)
    if options.document:
        replace_section(options.document, "confidence", table.markdown())


def _samples(half: str, num_sweeps: int) -> Iterator[Sample]:
    """Of each sweep with all that was before, and of some sweeps with the next one only."""
    for _, _, sweeps, counted in recordings(half, num_sweeps, [KITTI, *SCENARIOS]):
        estimator = make_method("online", preset("online"))
        for index in range(1, counted[-1] + 1):
            previous, *pair = (item.sweep for item in sweeps[index - 1 : index + 2])
            sample = _sample(sweeps[index], estimator, SweepTriplet(previous, *pair))
            if index in counted:
                yield False, sample
            if index in counted and index % _PAIR_EVERY == 0:
                alone = make_method("online", preset("online"))
                yield True, _sample(sweeps[index], alone, SweepTriplet(None, *pair))


class _Recorder:
    """Takes the place of a function of confidence: notes features, numbers the objects."""

    def __init__(self, kind: str) -> None:
        self._features_of = getattr(confidence, f"{kind}_features")
        self._confidence_of = getattr(confidence, f"{kind}_confidence")
        # Beyond any confidence, so that the points of an object can be told from the result.
        self._first = {_MOVING: 10, "doubtful": 10_000}[kind]

    def __call__(self, objects: Suspects, *more: object) -> NDArray[np.float32]:
        self.features = self._features_of(objects, *more)
        self.known = self._confidence_of(objects, *more)
        return np.arange(len(objects), dtype=np.float32) + self._first

    def samples(self, values: NDArray[np.float32], is_close: NDArray[np.bool_]) -> Samples:
        """What the points' values say of these objects."""
        is_own = (values >= self._first) & (values < self._first + len(self.known))
        owners = (values[is_own] - self._first).astype(int)
        counts = np.bincount(owners, minlength=len(self.known)).astype(float)
        sums = np.bincount(owners, is_close[is_own], len(self.known))
        seen = counts > 0
        close = sums[seen] / counts[seen]
        return Samples(self.features[seen], close, counts[seen], self.known[seen].astype(float))


def _sample(
    truth: TrueSweep, estimator: SceneFlowEstimator, triplet: SweepTriplet
) -> dict[str, Samples]:
    recorders = {kind: _Recorder(kind) for kind in (_MOVING, "doubtful")}
    with ExitStack() as stack:
        for kind, recorder in recorders.items():
            stack.enter_context(patch.object(scene, f"{kind}_confidence", recorder))
        estimate = estimator.estimate(triplet)
    rows = np.flatnonzero(truth.scored & estimate.kept)
    is_close = end_point_errors(estimate.flow[rows], truth.flow[rows]) < _CLOSE_M
    values = estimate.over_ground.confidence[rows]
    samples = {kind: each.samples(values, is_close) for kind, each in recorders.items()}
    standing = np.flatnonzero(values <= 1)
    standing = standing[:: max(1, len(standing) // _MAX_STANDING)]
    features = confidence.standing_features(truth.sweep.xyz[rows[standing]])
    ones, said = np.ones(len(standing)), values[standing].astype(float)
    return samples | {"standing": Samples(features, is_close[standing].astype(float), ones, said)}


def _fit(samples: Samples) -> NDArray[np.float64]:
    scale = np.maximum(samples.features.std(axis=0), 1e-9)
    scale[0] = 1.0
    features, counts = samples.features / scale, samples.counts**_POWER

    def loss(weights: NDArray[np.float64]) -> float:
        scores = features @ weights
        losses = np.logaddexp(0, scores) - samples.close * scores
        return float(np.average(losses, weights=counts)) + 1e-3 * float((weights[1:] ** 2).sum())

    weights: NDArray[np.float64] = minimize(loss, np.zeros(len(scale))).x / scale
    return weights


def _calibration(checked: list[Sample]) -> TextTable:
    rows = []
    for kind, are_pairs in (*((kind, False) for kind in _KINDS), (_MOVING, True)):
        samples = Samples.joined([each[kind] for is_pair, each in checked if is_pair == are_pairs])
        name = f"{kind}, two sweeps" if are_pairs else kind
        for low, high in pairwise(_EDGES):
            inside = (samples.said >= low) & (samples.said < high)
            counts = samples.counts[inside]
            if inside.any():
                mean, share = (
                    np.average(values[inside], weights=counts)
                    for values in (samples.said, samples.close)
                )
                cells = f"{mean:.2f}", f"{share:.2f}", f"{counts.sum():,.0f}", f"{len(counts):,}"
                rows.append([f"{name}, {low:g} to {min(high, 1):g}", *cells])
    header = ["confidence", "mean", "less than 0.1 m off", "points", "objects"]
    title = "Confidence and share of points that deserve it, reported half"
    return TextTable(header, rows, title)


if __name__ == "__main__":
    main()
