# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Cost of settings on one half of recordings: by true flow, or by landing errors of points."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree

from mnsf_ros.arrays import Floats, Ints
from mnsf_ros.core.flow_estimate import FlowEstimate, OverGround
from mnsf_ros.errors import EvaluationError, MnsfError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.scoring import failed_row, scored_row
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S

METHOD: Final = "online"
# Added for the share of examples without a flow, so that settings cannot win by failing.
FAILURE_COST: Final = 1.0

# For each recording, the examples of one half in order.
Half = Sequence[Sequence[Example]]
# Examples of a recording and settings, to the estimates; None where one fails.
Estimates = Callable[[Sequence[Example], Settings], Iterator[FlowEstimate | None]]


def estimates(examples: Sequence[Example], settings: Settings) -> Iterator[FlowEstimate | None]:
    """Yields the estimates of consecutive examples; None where one fails."""
    stream = Stream(settings, METHOD)
    for example in examples:
        try:
            yield stream.flow_of(example.triplet)
        except MnsfError:
            yield None


def read_halves(
    recordings: Sequence[EvaluatedRecording], options: EvaluationOptions
) -> tuple[Half, Half]:
    """Reads the first examples of both halves of each recording; no sweep is in both.

    The points to score are chosen by `options`, whatever settings are tried later: settings cannot
    win by leaving out difficult points.

    Raises:
        EvaluationError: A half of all recordings has no example.
        MnsfError: A recording cannot be read.
    """
    first, second = zip(*(_halves_of(one, options) for one in recordings), strict=True)
    if not (any(first) and any(second)):
        names = ", ".join(recording.name for recording in recordings)
        raise EvaluationError(
            f"{names}: too short to tune on one half and judge on the other; each half needs "
            "three consecutive sweeps"
        )
    return first, second


def _halves_of(
    recording: EvaluatedRecording, options: EvaluationOptions
) -> tuple[list[Example], list[Example]]:
    middle, most = recording.num_sweeps // 2, options.max_examples or recording.num_sweeps
    first: list[Example] = []
    second: list[Example] = []
    for example in read_examples(recording, options, Findings()):
        # The current sweep has one before it and one after it.
        if example.number + 1 < middle and len(first) < most:
            first.append(example)
        elif example.number - 1 >= middle:
            second.append(example)
            if len(second) == most:
                break
    return first, second


class LabelledJudge:
    """Judges settings by the three-way EPE of a half with true flow."""

    goal: Final = "three-way EPE (m)"

    def __init__(self, half: Half) -> None:
        self._half = half

    def __call__(self, settings: Settings) -> float:
        """Estimates and scores all examples; returns the cost, lower is better."""
        summary = self.summary(settings)
        epe_m = float(summary.get("three_way.mean", math.nan))
        failed = float(summary["num_failed"]) / sum(map(len, self._half))
        return math.inf if math.isnan(epe_m) else epe_m + FAILURE_COST * failed

    def summary(self, settings: Settings) -> pd.Series:
        """Returns the summary that `mnsf evaluate` would give of these examples alone."""
        rows = [
            failed_row(example, METHOD, "no flow")
            if estimate is None
            else scored_row(example, METHOD, estimate, estimate.time_ms)
            for examples in self._half
            for example, estimate in zip(examples, estimates(examples, settings), strict=True)
        ]
        return summarize(rows).loc[METHOD]


_LATER_S: Final = (0.2, 0.45)
_WANTED_S: Final = 0.3
_MAX_POINTS: Final = 4000
# Upper limit of landing errors.
_LIMIT_M: Final = 0.5
# Distance of a static point to the nearest point of a later sweep: noise, plus a share of the range
# for the spacing of the beams.
_NOISE_M: Final = 0.1
_SPACING: Final = 0.01


class ConsistencyJudge:
    """Judges settings without labels: do points land on a surface of a sweep about 0.3 s later?

    Points are moved by their motion over ground, at constant velocity, into a sweep that the
    estimate has not seen. If the motion is right, a point of that sweep is near: a mover called
    static stays behind, a static object called dynamic lands in free space. The few points that are
    not near a surface as static, by the settings at the start, weigh as much as all others. So
    neither "everything is static" nor "everything is dynamic" wins.
    """

    goal: Final = "landing error 0.3 s later (m)"

    def __init__(
        self, half: Half, settings: Settings, seed: int = 0, estimates_of: Estimates = estimates
    ) -> None:
        """Chooses the points that are not near a surface as static, with these settings."""
        self._half, self.estimates_of = half, estimates_of
        self._landings = [list(_landings(examples, seed)) for examples in half]
        static = self._errors(settings, are_static=True)
        ranges = [np.linalg.norm(one.xyz[:, :2], axis=1) for part in self._landings for one in part]
        limits = _NOISE_M + _SPACING * np.concatenate([*ranges, np.zeros(0)])
        self._is_open = static > limits

    def __call__(self, settings: Settings) -> float:
        """Returns the mean landing error of both kinds of points, metres, after all estimates."""
        errors = self._errors(settings)
        kinds = (errors[self._is_open], errors[~self._is_open])
        return sum(float(part.mean()) if len(part) else 0.0 for part in kinds) / len(kinds)

    def _errors(self, settings: Settings, *, are_static: bool = False) -> Floats:
        parts: list[Floats] = [np.zeros(0)]
        for examples, landings in zip(self._half, self._landings, strict=True):
            flows = self.estimates_of(examples, settings)
            known = [flow.over_ground if flow else None for flow in flows]
            parts.extend(landing.errors(known, are_static=are_static) for landing in landings)
        return np.concatenate(parts)


@dataclass(frozen=True, eq=False)
class _Landing:
    """Chosen points of an example, and the later sweep on which they should land."""

    place: int  # number of the example in its half
    later: int
    num_intervals: float  # time between them, in intervals to the next sweep
    rows: Ints  # (M,) the chosen points of the current sweep
    xyz: Floats  # (M, 3) metres, sensor frame
    tree: cKDTree  # points of the later sweep, its sensor frame

    def errors(self, known: Sequence[OverGround | None], *, are_static: bool) -> Floats:
        """Landing errors (M,), metres; `known` has one entry for each example of the half."""
        now, then = known[self.place], known[self.later]
        if now is None or then is None:
            return np.full(len(self.rows), _LIMIT_M)
        xyz = self.xyz
        if not are_static:
            xyz = xyz + now.motion[self.rows].astype(np.float64) * self.num_intervals
        landed = apply(np.linalg.inv(then.world_from_sensor) @ now.world_from_sensor, xyz)
        distances, _ = self.tree.query(landed, distance_upper_bound=_LIMIT_M)
        return np.minimum(distances, _LIMIT_M)


def _landings(examples: Sequence[Example], seed: int) -> Iterator[_Landing]:
    for place, example in enumerate(examples):
        later = _later(examples, place)
        if later is None or not len(examples[later].triplet.current.kept_xyz):
            continue
        current, interval_s = example.triplet.current, example.triplet.interval_s
        rows = np.flatnonzero(example.scored)
        if len(rows) > _MAX_POINTS:
            random = np.random.default_rng([seed, current.stamp_ns])
            rows = random.choice(rows, _MAX_POINTS, replace=False)
        seconds = _seconds_between(example, examples[later])
        yield _Landing(
            place,
            later,
            seconds / (interval_s or USUAL_INTERVAL_S),
            rows,
            current.xyz[rows].astype(np.float64),
            cKDTree(examples[later].triplet.current.kept_xyz),
        )


def _later(examples: Sequence[Example], place: int) -> int | None:
    """The example about 0.3 s later, if no sweep is missing in between."""
    first, apart_s = examples[place], dict[int, float]()
    for later, other in enumerate(examples[place + 1 :], place + 1):
        seconds = _seconds_between(first, other)
        has_gap = other.number - first.number != later - place
        if not has_gap and _LATER_S[0] <= seconds <= _LATER_S[1]:
            apart_s[later] = abs(seconds - _WANTED_S)
    return min(apart_s, key=lambda later: apart_s[later], default=None)


def _seconds_between(first: Example, later: Example) -> float:
    return (later.triplet.current.stamp_ns - first.triplet.current.stamp_ns) / NANOSECONDS
