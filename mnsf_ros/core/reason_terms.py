# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reasons of an estimate for calling a place dynamic or static, as terms with their texts."""

from collections.abc import Iterator
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Floats32, Ints
from mnsf_ros.core.flow_estimate import FlowEstimate, TrackedObject
from mnsf_ros.core.reason import Match, PointState, Reason, Verdict
from mnsf_ros.errors import EvaluationError
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

_RADIUS_M: Final = 0.5
_FARTHEST_M: Final = 2.0
# Parameters that change a verdict.
_SETTINGS: Final = {
    Verdict.GROUND: "a lower ground.margin_m leaves less",
    Verdict.TOO_HIGH: "the parameter objects.max_height_m is the limit",
    Verdict.OUTSIDE_CROP: "see the parameters crop.*",
    Verdict.OWN_BODY: "see the parameter crop.own_body",
    Verdict.TOO_FEW_POINTS: "the parameter objects.min_points is the limit",
    Verdict.TOO_LARGE: "the parameter objects.max_size_m is the limit",
    Verdict.LEFT_OUT: "the parameter objects.max_suspects is the limit",
    Verdict.REFUSED: "a lower objects.min_probability accepts more",
}


def rows_at(xyz: Floats32, estimate: FlowEstimate, place_m: tuple[float, float]) -> Ints:
    """Returns the rows (M,) of what is at a place (x, y), metres, sensor frame.

    That is the tracked object whose box it is in, else points near by; ground only if alone.

    Raises:
        EvaluationError: There is none.
    """
    known = estimate.over_ground
    if known is not None and known.track_ids is not None:
        for item in known.objects:
            rows = np.flatnonzero(known.track_ids == item.track_id)
            if len(rows) and _is_in_box(item, place_m):
                return rows
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


def _is_in_box(item: TrackedObject, place_m: tuple[float, float]) -> bool:
    x, y = np.subtract(place_m, item.center[:2])
    cos, sin = np.cos(item.yaw), np.sin(item.yaw)
    along, across = cos * x + sin * y, cos * y - sin * x
    return bool(2 * abs(along) <= item.size[0] and 2 * abs(across) <= item.size[1])


def reason_for(estimate: FlowEstimate, rows: Ints) -> Reason:
    """Returns the reason for the decision about the rows (M,) of one object.

    Raises:
        EvaluationError: The method gives no reasons.
    """
    if estimate.reason_of is None or estimate.over_ground is None:
        raise EvaluationError("this method gives no reasons; online does")
    return estimate.reason_of(rows)


def reason_terms(
    xyz: Floats32, estimate: FlowEstimate, rows: Ints, interval_s: float
) -> dict[str, str]:
    """Returns terms and their texts for the decision about the rows (M,) of one object.

    Args:
        xyz: (N, 3) metres, the sweep.
        estimate: Of the sweep.
        rows: (M,) rows of the sweep.
        interval_s: Time to the next sweep.

    Raises:
        EvaluationError: As of `reason_for`.
    """
    reason, known = reason_for(estimate, rows), estimate.over_ground
    middle = ", ".join(f"{value:.2f}" for value in np.median(xyz[rows], axis=0))
    called = rows[:0] if known is None else rows[known.dynamic[rows]]
    terms = {
        "Place": f"{len(rows)} points around ({middle}) m",
        "Called dynamic": f"{len(called)} of {len(rows)} points",
        "Reason": _verdict_text(reason, _object_of(estimate, called)),
    }
    return terms | dict(_object_terms(reason, interval_s or USUAL_INTERVAL_S))


def _object_of(estimate: FlowEstimate, called: Ints) -> str:
    """The tracked object of most of the rows (M,) that are called dynamic; empty without rows."""
    if len(called) == 0:
        return ""
    known = estimate.over_ground
    if known is None or known.track_ids is None or not known.track_ids[called].any():
        return "a mover beside it"
    ids = known.track_ids[called]
    return f"object {np.bincount(ids[ids > 0]).argmax()}"


def _verdict_text(reason: Reason, mover: str) -> str:
    """The outcome, with the `mover` that the points belong to if they are called dynamic."""
    if reason.leader is not None:
        x, y, _ = reason.leader.place
        return (
            f"goes along with what touches it at ({x:.1f}, {y:.1f}) m and is dynamic with "
            f"probability {reason.leader.probability:.3g}; both are {mover}"
        )
    if mover and reason.verdict is not Verdict.DYNAMIC:
        return f"{reason.verdict.value}, but goes along with {mover}"
    hint = _SETTINGS.get(reason.verdict)
    return f"{reason.verdict.value}{f' ({hint})' if hint else ''}"


def _object_terms(reason: Reason, interval_s: float) -> Iterator[tuple[str, str]]:
    if reason.num_points:
        yield "Object", f"{reason.num_points} points after thinning, {reason.size_m:.1f} m long"
    if reason.motion is not None:
        speed_m_s = float(np.linalg.norm(reason.motion)) / interval_s
        text = f"{vector_text(reason.motion)} m to the next sweep, {speed_m_s:.1f} m/s"
        yield "Motion found", text
    if reason.start is not None:
        yield "The search started at", f"{vector_text(reason.start)} m"
    for one in reason.sweeps:
        moving = "" if one.moving is None else f"; if it moves {_match_text(one.moving)}"
        yield f"Sweep at {one.age_s:+.1f} s", f"if static {_match_text(one.static)}{moving}"
    for name, value in reason.evidence.items():
        yield f"Evidence, {name}", f"{value:.3g}"


def vector_text(vector: Floats) -> str:
    """Returns a vector with two decimals."""
    return f"({', '.join(f'{value:.2f}' for value in vector)})"


def _match_text(match: Match) -> str:
    shown = PointState.HIT, PointState.FREE, PointState.HIDDEN
    shares = ", ".join(f"{state.text} {match.share(state):.0%}" for state in shown)
    return f"{match.residual_m:.3f} m ({shares})"
