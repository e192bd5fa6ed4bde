# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reasons for calling a place of a sweep dynamic or static, as text."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate, Reason, Verdict
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.movers import LostBy, lost_by
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.scoring import true_motion
from mnsf_ros.online.stream import Stream
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S

# A stamp that was printed with three decimals is off by less.
_SAME_STAMP_NS: Final = 1_000_000
# Memory of the method: earlier sweeps have no effect.
_PAST_S: Final = 3.0
_RADIUS_M: Final = 0.5
_FARTHEST_M: Final = 2.0
_MOVES: Final = 0.5  # share of the points of a mover that are dynamic
# Stages of verdicts, where truth does not tell; the others have the name of the verdict.
_STAGES: Final = {
    Verdict.NO_BETTER_MOTION: f"{LostBy.FIRST_GUESS.value} or {LostBy.FIT.value}",
    Verdict.REFUSED: LostBy.GATE.value,
    Verdict.DYNAMIC: LostBy.GATE.value,
}
# Parameters that change a verdict.
_SETTINGS: Final = {
    Verdict.NO_OBJECT: "see the parameters crop.* and ground.*",
    Verdict.TOO_FEW_POINTS: "the parameter objects.min_points is the limit",
    Verdict.TOO_LARGE: "the parameter objects.max_size_m is the limit",
    Verdict.LEFT_OUT: "the parameter objects.max_suspects is the limit",
    Verdict.REFUSED: "a lower objects.min_probability accepts more",
}


def explain(
    recording: EvaluatedRecording,
    options: EvaluationOptions,
    stamp_ns: int,
    place_m: tuple[float, float],
    method: str = "",
) -> list[str]:
    """Returns the decision of a method at a place (x, y) metres in the sensor frame, as lines.

    `method` defaults to the settings' `method.name`. The 3 s before the sweep are estimated, too,
    because it remembers them.

    Raises:
        EvaluationError: There is no such sweep, no point near the place, or the method gives no
            reasons.
        MnsfError: The recording cannot be read, or the estimate fails.
    """
    example, estimate = _estimated(recording, options, stamp_ns, method)
    stamp_s = example.triplet.current.stamp_ns / NANOSECONDS
    heading = f"{recording.name}, sweep {example.number}, stamp {stamp_s:.3f} s"
    return [heading, *decision(example, estimate, rows_at(example, estimate, place_m))]


def decision(example: Example, estimate: FlowEstimate, rows: NDArray[np.int64]) -> list[str]:
    """Returns the decision of an estimate about the rows (M,) of one object, as lines.

    Raises:
        EvaluationError: The method gives no reasons.
    """
    if estimate.reason_of is None or estimate.over_ground is None:
        raise EvaluationError("this method gives no reasons; online does")
    reason, truth = estimate.reason_of(rows), _truth_at(example, rows)
    xyz = example.triplet.current.xyz[rows]
    middle = ", ".join(f"{value:.2f}" for value in np.median(xyz, axis=0))
    num_called = int(np.count_nonzero(estimate.over_ground.dynamic[rows]))
    hint = _SETTINGS.get(reason.verdict)
    verdict = reason.verdict.value
    if num_called and reason.verdict is not Verdict.DYNAMIC:
        verdict += ", but it joined a mover beside it"
    lines = [
        f"Place: {len(rows)} points around ({middle}) m",
        f"Called dynamic: {num_called} of {len(rows)} points",
        f"Reason: {verdict}{f' ({hint})' if hint else ''}",
        f"Decided by the stage: {_stage(reason, truth if num_called < len(rows) / 2 else None)}",
    ]
    return [*lines, *_object_lines(example, reason), *_truth_lines(reason, truth)]


@dataclass(frozen=True)
class _Truth:
    """True motion at a place.

    Attributes:
        motion: (3,) metres over ground until the next sweep.
        share: Share of the points that are dynamic.
        speed_m_s: Mean speed.
    """

    motion: NDArray[np.float64]
    share: float
    speed_m_s: float


def _stage(reason: Reason, truth_if_missed: _Truth | None) -> str:
    """The stage under the name that it has in the report."""
    if truth_if_missed is not None and truth_if_missed.share > _MOVES:
        return lost_by(reason, truth_if_missed.motion).value
    return _STAGES.get(reason.verdict) or LostBy[reason.verdict.name].value


def _estimated(
    recording: EvaluatedRecording, options: EvaluationOptions, stamp_ns: int, method: str
) -> tuple[Example, FlowEstimate]:
    """The example of a stamp and its estimate."""
    stream = Stream(options.settings, method)
    stamps_ns: list[int] = []
    with recording.open() as reader:
        for example in read_examples(reader, recording, options, Findings()):
            now_ns = example.triplet.current.stamp_ns
            stamps_ns.append(now_ns)
            if now_ns < stamp_ns - _PAST_S * NANOSECONDS:
                continue
            estimate = stream.flow_of(example.triplet)
            if abs(now_ns - stamp_ns) <= _SAME_STAMP_NS:
                return example, estimate
            if now_ns > stamp_ns:
                break
    if not stamps_ns:
        raise EvaluationError(f"{recording.name}: contains no consecutive sweeps")
    nearest = min(stamps_ns, key=lambda one: abs(one - stamp_ns)) / NANOSECONDS
    raise EvaluationError(
        f"{recording.name}: no sweep with neighbours has the stamp {stamp_ns / NANOSECONDS:.3f} s; "
        f"the nearest one has {nearest:.3f} s"
    )


def rows_at(
    example: Example, estimate: FlowEstimate, place_m: tuple[float, float]
) -> NDArray[np.int64]:
    """Returns the points near a place (x, y), metres, sensor frame; ground only if alone.

    Raises:
        EvaluationError: There is none.
    """
    xyz = example.triplet.current.xyz
    distances_m = np.hypot(*(xyz[:, :2].astype(np.float64) - place_m).T)
    for mask in (estimate.kept, np.ones(len(xyz), dtype=bool)):
        near = np.flatnonzero(mask & (distances_m <= _RADIUS_M))
        if len(near):
            return near
    nearest = int(np.argmin(distances_m)) if len(xyz) else 0
    if len(xyz) and distances_m[nearest] <= _FARTHEST_M:
        return np.array([nearest])
    x, y = place_m
    found = f"; the nearest one is {distances_m[nearest]:.1f} m away" if len(xyz) else ""
    raise EvaluationError(f"no point within {_FARTHEST_M:g} m of ({x:g}, {y:g}) m{found}")


def _object_lines(example: Example, reason: Reason) -> Iterator[str]:
    if reason.num_points:
        yield f"Object: {reason.num_points} points after thinning, {reason.size_m:.1f} m long"
    if reason.motion is not None:
        interval_s = example.triplet.interval_s or USUAL_INTERVAL_S
        speed_m_s = float(np.linalg.norm(reason.motion)) / interval_s
        yield f"Motion found: {_vector(reason.motion)} m to the next sweep, {speed_m_s:.1f} m/s"
    if reason.start is not None:
        yield f"The search started at {_vector(reason.start)} m"
    for words, residuals_m in (("static", reason.static_m), ("it moves", reason.moving_m)):
        if residuals_m:
            yield f"Residual if {words}: {_listed(residuals_m)}"
    for name, value in reason.evidence.items():
        yield f"Evidence, {name}: {value:.3f}"


def _truth_at(example: Example, rows: NDArray[np.int64]) -> _Truth | None:
    truth = example.truth
    if truth is None or not truth.valid[rows].any():
        return None
    # The sensor's own motion shows in all points of the sweep.
    every = np.flatnonzero(truth.valid)
    known, own_m = true_motion(example, truth, every)
    own = np.isin(every, rows)
    motion = known.velocity[own].mean(axis=0) * known.interval_s
    speed_m_s = float(own_m[own].mean()) / known.interval_s
    return _Truth(motion, float(known.dynamic[own].mean()), speed_m_s)


def _truth_lines(reason: Reason, truth: _Truth | None) -> Iterator[str]:
    if truth is None:
        return
    yield (
        f"Truth: {truth.share:.0%} of the points dynamic, {_vector(truth.motion)} m to the next "
        f"sweep, {truth.speed_m_s:.1f} m/s"
    )
    for words, guess in (("motion found", reason.motion), ("start of the search", reason.start)):
        if guess is not None:
            off_m = float(np.linalg.norm(guess - truth.motion))
            yield f"The {words} is off by {off_m:.2f} m"


def _vector(vector: NDArray[np.float64]) -> str:
    return f"({', '.join(f'{value:.2f}' for value in vector)})"


def _listed(values: Mapping[str, float]) -> str:
    return ", ".join(f"{value:.3f} m ({name})" for name, value in values.items())
