# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether a stream is wrong, and whether it says so, sweep by sweep."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from lost_drives import Drive, Taken

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.presets import preset
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Sweep

# A sweep is wrong if the flow of its static points is further off on the mean, or if more of those
# above ground are called dynamic.
_OFF_M: Final = 0.1
_FALSE_SHARE: Final = 0.02
_FALSE_POINTS: Final = 200
# The first sweeps are not counted: a stream that begins knows nothing yet.
_NUM_FIRST: Final = 3
# So many sweeps in sequence show that it is right again.
_STAYS: Final = 3

Push = Callable[[Sweep], FlowEstimate | None]


@dataclass(frozen=True)
class Verdict:
    """Of a sweep: whether its estimate, or its ego motion, is wrong, and why that is not known."""

    is_wrong: bool
    is_ego_wrong: bool
    lost: str

    @property
    def is_right(self) -> bool:
        """Whether it is right, and believed."""
        return not self.is_wrong and not self.lost


@dataclass(frozen=True)
class Score:
    """Numbers of the counted sweeps of a drive that have an estimate and static points.

    `ego_unsaid` are those of the wrong and unsaid ones whose ego motion itself is wrong.
    `sweeps_until_right` are those after the disturbance; infinite if it is never right again, NaN
    if there is nothing to wait for.
    """

    sweeps: int
    wrong_said: int
    wrong_unsaid: int
    ego_unsaid: int
    right_said: int
    sweeps_until_right: float


def score(drive: Drive, push: Push | None = None) -> Score:
    """The score of a stream that takes the sweeps of a drive; `push` replaces its method."""
    verdicts = list(judged(drive, push))
    counted = [each for each in verdicts[_NUM_FIRST:] if each is not None]
    return Score(
        len(counted),
        sum(each.is_wrong and bool(each.lost) for each in counted),
        sum(each.is_wrong and not each.lost for each in counted),
        sum(each.is_wrong and each.is_ego_wrong and not each.lost for each in counted),
        sum(not each.is_wrong and bool(each.lost) for each in counted),
        math.nan if drive.end is None else _until_right(verdicts[drive.end :]),
    )


def judged(drive: Drive, push: Push | None = None) -> Iterator[Verdict | None]:
    """Yields the verdict of each sweep but the last; None without estimate or static points."""
    sweeps = _labelled(drive) if drive.undisturbed else drive.sweeps
    estimates = _estimates(sweeps, push or new_stream(drive.rate_hz).push)
    for taken, following, estimate in zip(sweeps, sweeps[1:], estimates, strict=False):
        yield _verdict(taken, following, estimate)


def new_stream(rate_hz: float) -> Stream:
    """A stream of the online method; it takes sweeps that come at half of the rate."""
    settings = preset("online")
    longest_s = max(settings.buffer.max_interval_s, 2.0 / rate_hz)
    return Stream(replace(settings, buffer=replace(settings.buffer, max_interval_s=longest_s)))


def _estimates(sweeps: Sequence[Taken], push: Push) -> list[FlowEstimate | None]:
    """The estimates of all sweeps but the last; each comes with the sweep that follows."""
    estimates = []
    for taken in sweeps:
        try:
            estimates.append(push(taken.sweep))
        except MnsfError:
            estimates.append(None)
    return estimates[1:]


def _verdict(taken: Taken, following: Taken, estimate: FlowEstimate | None) -> Verdict | None:
    if estimate is None or not taken.static.any():
        return None
    known = estimate.over_ground
    assert known is not None  # noqa: S101 - the online method has an ego motion
    off_m = np.linalg.norm(estimate.flow - taken.static_flow(following), axis=1)
    judged_points = taken.static & taken.above_ground
    false = np.count_nonzero(known.dynamic & judged_points)
    too_many = max(_FALSE_POINTS, _FALSE_SHARE * np.count_nonzero(judged_points))
    is_wrong = bool(off_m[taken.static].mean() > _OFF_M) or false > too_many
    static = taken.sweep.xyz[taken.static].astype(float)
    motions = known.next_from_current, taken.motion_to(following)
    ego_off = np.subtract(*(apply(each, static) for each in motions))
    is_ego_wrong = bool(np.linalg.norm(ego_off, axis=1).mean() > _OFF_M)
    return Verdict(is_wrong, is_ego_wrong, known.lost)


def _until_right(verdicts: Sequence[Verdict | None]) -> float:
    """Number of sweeps before those that are right and stay so."""
    are_right = [each is not None and each.is_right for each in verdicts]
    for number in range(len(are_right) - _STAYS + 1):
        if all(are_right[number : number + _STAYS]):
            return number
    return math.inf


def _labelled(drive: Drive) -> list[Taken]:
    """The sweeps of a drive without the points that move where nothing disturbs the stream."""
    estimates = _estimates(drive.undisturbed, new_stream(drive.rate_hz).push)
    moving = {
        taken.sweep.stamp_ns: estimate.over_ground.dynamic
        for taken, estimate in zip(drive.undisturbed, estimates, strict=False)
        if estimate is not None
    }
    return [
        replace(taken, static=taken.static & ~moving.get(taken.sweep.stamp_ns, ~taken.static))
        for taken in drive.sweeps
    ]
