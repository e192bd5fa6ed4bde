# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reasons of the decision at a place of a sweep, dynamic or static, as text and picture."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Ints
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.reason import Match, PointState, Reason, SweepTerms, Verdict
from mnsf_ros.core.reason_terms import reason_for, reason_terms, rows_at, vector_text
from mnsf_ros.drawing.charts import Panel, match_picture
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.movers import LostBy, lost_by
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.scoring import true_motion
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import NANOSECONDS

# Larger than the rounding of a stamp that was printed with three decimals.
_SAME_STAMP_NS: Final = 1_000_000
# Memory of the method: earlier sweeps have no effect.
_PAST_S: Final = 3.0
_MOVES: Final = 0.5  # share of the points of a mover that are dynamic
# Stages of verdicts, where truth does not tell; the others have the name of the verdict.
_STAGES: Final = {
    Verdict.NO_BETTER_MOTION: f"{LostBy.FIRST_GUESS.value} or {LostBy.FIT.value}",
    Verdict.REFUSED: LostBy.GATE.value,
    Verdict.DYNAMIC: LostBy.GATE.value,
}


def explain(
    recording: EvaluatedRecording,
    options: EvaluationOptions,
    stamp_ns: int,
    place_m: tuple[float, float],
    method: str = "",
) -> tuple[list[str], bytes | None]:
    """Returns the decision of a method at a place (x, y), metres, sensor frame, as lines of text.

    And a PNG file of the object in the other sweeps; None without an object. `method` defaults to
    the settings' `method.name`. The 3 s before the sweep are estimated, too, as methods remember
    them.

    Raises:
        EvaluationError: There is no such sweep, no point near the place, or the method gives no
            reasons.
        MnsfError: The recording cannot be read, or the estimate fails.
    """
    example, estimate = _estimated(recording, options, stamp_ns, method)
    stamp_s = example.triplet.current.stamp_ns / NANOSECONDS
    heading = f"{recording.name}, sweep {example.number}, stamp {stamp_s:.3f} s"
    rows = rows_at(example.triplet.current.xyz, estimate, place_m)
    lines = [heading, *decision(example, estimate, rows)]
    reason = reason_for(estimate, rows)
    return lines, _picture(f"{heading}: {reason.verdict.value}", reason)


def _picture(title: str, reason: Reason) -> bytes | None:
    """Draws the object in each other sweep: as static above, as moving below if that was fitted."""
    matches = {
        "static": [(one, one.static) for one in reason.sweeps],
        "moves": [(one, one.moving) for one in reason.sweeps if one.moving is not None],
    }
    rows = [[_panel(name, *pair) for pair in pairs] for name, pairs in matches.items() if pairs]
    return match_picture(title, rows) if rows else None


def _panel(name: str, sweep: SweepTerms, match: Match) -> Panel:
    title = f"{name}, sweep at {sweep.age_s:+.1f} s: residual {match.residual_m:.3f} m"
    positions = {state.text: match.positions[match.states == state] for state in PointState}
    return Panel(title, sweep.points, positions)


def decision(example: Example, estimate: FlowEstimate, rows: Ints) -> list[str]:
    """Returns the decision of an estimate about the rows (M,) of one object, as lines.

    Raises:
        EvaluationError: The method gives no reasons.
    """
    reason, (motion, share, truth) = reason_for(estimate, rows), _truth_at(example, rows)
    triplet, known = example.triplet, estimate.over_ground
    terms = reason_terms(triplet.current.xyz, estimate, rows, triplet.interval_s)
    stage = _STAGES.get(reason.verdict) or LostBy.of(reason.verdict).value
    is_missed = known is not None and 2 * np.count_nonzero(known.dynamic[rows]) < len(rows)
    if is_missed and share > _MOVES:
        stage = lost_by(reason, motion).value
    lines = [f"{term}: {text}" for term, text in terms.items()]
    lines.insert(3, f"Decided by the stage: {stage}")
    guesses = {"motion found": reason.motion, "start of the search": reason.start}
    off = [
        f"The {words} is off by {float(np.linalg.norm(guess - motion)):.2f} m"
        for words, guess in guesses.items()
        if guess is not None
    ]
    return [*lines, truth, *off] if truth else lines


def _estimated(
    recording: EvaluatedRecording, options: EvaluationOptions, stamp_ns: int, method: str
) -> tuple[Example, FlowEstimate]:
    stream = Stream(options.settings, method)
    stamps_ns: list[int] = []
    findings = Findings()
    for example in read_examples(recording, options, findings):
        now_ns = example.triplet.current.stamp_ns
        stamps_ns.append(now_ns)
        if now_ns < stamp_ns - _PAST_S * NANOSECONDS:
            continue
        estimate = stream.flow_of(example.triplet)
        if abs(now_ns - stamp_ns) <= _SAME_STAMP_NS:
            return example, estimate
        if now_ns > stamp_ns:
            break
    if not stamps_ns and findings.damages:
        raise next(iter(findings.damages)).error()
    if not stamps_ns:
        raise EvaluationError(f"{recording.name}: contains no consecutive sweeps")
    nearest = min(stamps_ns, key=lambda one: abs(one - stamp_ns)) / NANOSECONDS
    raise EvaluationError(
        f"{recording.name}: no sweep with neighbours has the stamp {stamp_ns / NANOSECONDS:.3f} s; "
        f"the nearest one has {nearest:.3f} s"
    )


def _truth_at(example: Example, rows: Ints) -> tuple[Floats, float, str]:
    """Returns mean true motion (3,) over ground, share of dynamic points, and both as a line."""
    truth = example.truth
    if truth is None or not truth.valid[rows].any():
        return np.zeros(3), 0.0, ""
    # Ego motion is fitted to all points of the sweep.
    every = np.flatnonzero(truth.valid)
    known, own_m = true_motion(example, truth, every)
    own = np.flatnonzero(np.isin(every, rows))
    motion, share = known.mean_motion(own), float(known.dynamic[own].mean())
    speed_m_s = float(own_m[own].mean()) / known.interval_s
    line = (
        f"Truth: {share:.0%} of the points dynamic, {vector_text(motion)} m to the next sweep, "
        f"{speed_m_s:.1f} m/s"
    )
    return motion, share, line
