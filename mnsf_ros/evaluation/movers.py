# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Score of the movers of one sweep: the flag `dynamic` of points, and tracked objects.

An object is a mover if most of its scored points are dynamic in truth, and found if at least half
of them are called dynamic.
"""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints, Ints32
from mnsf_ros.core.flow_estimate import OverGround, TrackedObject
from mnsf_ros.core.reason import Reason, Verdict
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# Largest error of the motion of a mover that only the gate rejected.
_CLOSE_M: Final = 0.1
# Objects and false movers of fewer points do not count.
_MIN_POINTS: Final = 20
_MIN_GHOST_POINTS: Final = 10
_FOUND_SHARE: Final = 0.5
# Points between this speed and the threshold of dynamic are neither wrong nor missed.
_CREEPING_M_S: Final = 0.25
# Velocities count after this time of tracking, directions above this speed.
_SETTLED_S: Final = 0.5
_MIN_DIRECTED_M_S: Final = 1.0
# Slower objects are static.
STOPPED_M_S: Final = 0.1
_TINY_S: Final = 1e-3
# Largest error of a start from which a fit should find the motion.
_GOOD_START_M: Final = 0.3


class LostBy(Enum):
    """Stage that rejected a mover."""

    NO_OBJECT = "no object"
    OWN_BODY = "own body"
    TOO_FEW_POINTS = "too few points"
    TOO_LARGE = "too large"
    NOT_SUSPECTED = "not suspected"
    LEFT_OUT = "left out"
    FIRST_GUESS = "first guess"
    FIT = "fit"
    GATE = "gate"
    PARTLY = "found in part"

    @classmethod
    def of(cls, verdict: Verdict) -> "LostBy":
        """Returns the stage with the name of a verdict; without such a stage, `NO_OBJECT`."""
        return cls.__members__.get(verdict.name, cls.NO_OBJECT)


@dataclass(frozen=True)
class ObjectRow:
    """Score of one true object in one sweep."""

    object_id: int  # in the truth
    kind: str  # `SurfaceClass` in lower case; `unknown` without a label
    moves: bool  # most of its points are dynamic in truth
    speed_m_s: float  # true speed over ground
    range_m: float  # horizontal distance from the sensor
    num_points: int  # scored points
    called: float  # share of its points that are called dynamic
    velocity_error_m_s: float = math.nan  # of its tracked object, after 0.5 s of tracking
    direction_error_rad: float = math.nan  # likewise, from 1 m/s on
    place_m: tuple[float, float] = (math.nan, math.nan)  # median x and y, sensor frame
    lost_by: LostBy | None = None  # stage that rejected a mover, if the method has reasons

    @property
    def is_found(self) -> bool:
        """Whether at least half of its points are called dynamic."""
        return self.called >= _FOUND_SHARE


@dataclass(frozen=True)
class MoverRow:
    """Score of the movers of one sweep."""

    points: tuple[int, int, int]  # true positive, false positive, false negative dynamic points
    num_ghosts: int  # false movers: tracked objects, or motions, most of which are static in truth
    objects: list[ObjectRow] = field(default_factory=list)  # true movers, and objects called so
    standing: list[int] = field(default_factory=list)  # ids of other objects, if they are static


@dataclass(frozen=True, eq=False)
class TrueMotion:
    """The truth of the M scored points of a sweep."""

    xyz: Floats32  # (M, 3) metres, sensor frame
    velocity: Floats  # (M, 3) m/s over ground, axes of the current sweep
    dynamic: Bools  # (M,)
    class_id: NDArray[np.uint8]  # (M,) `SurfaceClass`, 0 if unknown
    object_id: NDArray[Any] | None  # (M,) 0 for points of no object; None if unknown
    interval_s: float = USUAL_INTERVAL_S  # to the next sweep

    def mean_motion(self, rows: Ints) -> Floats:
        """Returns the mean motion (3,) of some points until the next sweep, metres over ground."""
        return self.velocity[rows].mean(axis=0) * self.interval_s


def mover_row(
    truth: TrueMotion,
    estimate: OverGround,
    rows: Ints,
    reason_of: Callable[[Ints], Reason] | None = None,
) -> MoverRow:
    """Scores the movers of an estimate; `rows` (M,) of it belong to the points of the truth.

    `reason_of` is as in `FlowEstimate`.
    """
    called = estimate.dynamic[rows]
    moves = truth.dynamic | (np.sqrt((truth.velocity**2).sum(axis=1)) > _CREEPING_M_S)
    counts = (called & truth.dynamic, called & ~moves, ~called & truth.dynamic)
    right, wrong, missed = (int(np.count_nonzero(each)) for each in counts)
    known = estimate.track_ids
    tracks = np.zeros(len(rows), np.int32) if known is None else known[rows]
    return MoverRow(
        points=(right, wrong, missed),
        num_ghosts=_num_ghosts(estimate.motion[rows][called], tracks[called], moves[called]),
        objects=[
            replace(item, lost_by=lost_by(reason_of(rows[own]), truth.mean_motion(own)))
            if reason_of is not None and item.moves and not item.is_found
            else item
            for item, own in _object_rows(truth, called, tracks, estimate.objects)
        ],
        standing=_standing(truth, called),
    )


def _num_ghosts(motions: Floats32, tracks: Ints32, is_mover: Bools) -> int:
    """Number of tracked objects, and of motions without one, that are mostly static in truth."""
    num_ghosts = 0
    for part, names in ((tracks > 0, tracks[:, None]), (tracks == 0, motions)):
        if not part.any():
            continue
        _, owners = np.unique(names[part], axis=0, return_inverse=True)
        owners = owners.ravel()  # NumPy 2.0 returned it with the shape of a column
        counts, false = np.bincount(owners), np.bincount(owners, weights=~is_mover[part])
        num_ghosts += int(np.count_nonzero((counts >= _MIN_GHOST_POINTS) & (false > counts / 2)))
    return num_ghosts


def _object_rows(
    truth: TrueMotion, called: Bools, tracks: Ints32, objects: Sequence[TrackedObject]
) -> Iterator[tuple[ObjectRow, Ints]]:
    """Each mover or object called one, and its rows in the truth."""
    if truth.object_id is None:
        return
    ids = truth.object_id
    by_track = {item.track_id: item for item in objects}
    for object_id in np.unique(ids[(truth.dynamic | called) & (ids > 0)]):
        own = np.flatnonzero(ids == object_id)
        moves, share = truth.dynamic[own].mean() > 0.5, float(called[own].mean())
        if len(own) < _MIN_POINTS or not (moves or share >= _FOUND_SHARE):
            continue
        velocity = truth.velocity[own].mean(axis=0)
        followed = tracks[own][called[own] & (tracks[own] > 0)]
        track = by_track.get(int(np.bincount(followed).argmax())) if len(followed) else None
        error_m_s, error_rad = _velocity_errors(velocity, track)
        x_m, y_m = np.median(truth.xyz[own, :2], axis=0).tolist()
        classes = np.bincount(truth.class_id[own])
        item = ObjectRow(
            object_id=int(object_id),
            kind=_kind(int(classes.argmax())),
            moves=bool(moves),
            speed_m_s=float(np.linalg.norm(velocity)),
            range_m=float(np.median(np.hypot(*truth.xyz[own, :2].T.astype(np.float64)))),
            place_m=(x_m, y_m),
            num_points=len(own),
            called=share,
            velocity_error_m_s=error_m_s,
            direction_error_rad=error_rad,
        )
        yield item, own


def _standing(truth: TrueMotion, called: Bools) -> list[int]:
    if truth.object_id is None:
        return []
    ids, owners, counts = np.unique(truth.object_id, return_inverse=True, return_counts=True)
    owners = owners.ravel()  # NumPy 2.0 returned it with the shape of a column
    speeds = np.sqrt((truth.velocity**2).sum(axis=1))
    mean_m_s, share = (np.bincount(owners, each) / counts for each in (speeds, called))
    stands = (ids > 0) & (counts >= _MIN_POINTS) & (mean_m_s < STOPPED_M_S)
    return ids[stands & (share < _FOUND_SHARE)].tolist()


def lost_by(reason: Reason, true_motion: Floats) -> LostBy:
    """Returns the stage that rejected a missed mover, by the reason of the decision on its points.

    `true_motion` is (3,) metres over ground until the next sweep.
    """
    if reason.verdict is Verdict.DYNAMIC:
        return LostBy.PARTLY
    if reason.verdict not in (Verdict.NO_BETTER_MOTION, Verdict.REFUSED):
        return LostBy.of(reason.verdict)
    if reason.motion is not None and np.linalg.norm(reason.motion - true_motion) <= _CLOSE_M:
        return LostBy.GATE
    has_started_well = (
        reason.start is not None and np.linalg.norm(reason.start - true_motion) <= _GOOD_START_M
    )
    return LostBy.FIT if has_started_well else LostBy.FIRST_GUESS


def _kind(class_id: int) -> str:
    known = class_id in SurfaceClass._value2member_map_
    return SurfaceClass(class_id).name.lower().replace("_", " ") if known else "unknown"


def _velocity_errors(velocity: Floats, track: TrackedObject | None) -> tuple[float, float]:
    """Errors of velocity, m/s, and of its direction, radians; NaN if they do not count."""
    if track is None or track.age_s < _SETTLED_S - _TINY_S:
        return math.nan, math.nan
    error_m_s = float(np.linalg.norm(track.velocity - velocity))
    found, true = track.velocity[:2], velocity[:2]
    lengths = np.linalg.norm(found) * np.linalg.norm(true)
    if np.linalg.norm(velocity) < _MIN_DIRECTED_M_S or lengths == 0:
        return error_m_s, math.nan
    return error_m_s, math.acos(min(1.0, max(-1.0, float(found @ true / lengths))))
