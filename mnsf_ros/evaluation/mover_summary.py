# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How well movers are found and followed over time, from what was said of them sweep by sweep."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.movers import STOPPED_M_S, MoverRow, ObjectRow
from mnsf_ros.sweeps.sweep import NANOSECONDS

# An object that was away for longer comes into view anew.
_MAX_AWAY_S: Final = 0.5
_TINY_S: Final = 1e-3


@dataclass(frozen=True)
class MoverGroup:
    """Movers that are scored together.

    Attributes:
        name: What they are called in tables.
        speeds_m_s: From, to.
        max_range_m: Those farther off do not count.
        first_s: This long after it came into view a mover need not be found yet.
        kind: Its kind, see `ObjectRow`; empty for all.
    """

    name: str
    speeds_m_s: tuple[float, float] = (0.5, math.inf)
    max_range_m: float = 50.0
    first_s: float = 0.3
    kind: str = ""

    def has(self, row: ObjectRow) -> bool:
        """Whether an object of a sweep belongs to the group."""
        low, high = self.speeds_m_s
        is_of_kind = not self.kind or row.kind == self.kind
        is_near = row.range_m <= self.max_range_m
        return row.moves and is_of_kind and low <= row.speed_m_s < high and is_near


FAST: Final = MoverGroup("2 m/s and faster, to 50 m", (2.0, math.inf))
SLOW: Final = MoverGroup("0.5 to 2 m/s, to 30 m", (0.5, 2.0), 30.0, 0.6)
# The first two are those that targets are about.
MOVER_GROUPS: Final = (
    FAST,
    SLOW,
    MoverGroup("2 to 5 m/s, to 50 m", (2.0, 5.0)),
    MoverGroup("5 to 10 m/s, to 50 m", (5.0, 10.0)),
    MoverGroup("10 m/s and faster, to 50 m", (10.0, math.inf)),
    MoverGroup("cars, to 50 m", kind="car"),
    MoverGroup("large vehicles, to 50 m", kind="large vehicle"),
    MoverGroup("two-wheelers, to 50 m", kind="cyclist"),
    MoverGroup("pedestrians, to 30 m", max_range_m=30.0, first_s=0.6, kind="pedestrian"),
)


@dataclass(frozen=True)
class GroupSummary:
    """How well the movers of a group were found and followed.

    Attributes:
        num_movers: Movers, each time that one comes into view.
        num_sweeps: Sweeps of all movers together after the first ones, see `MoverGroup.first_s`.
        found: Share of these in which the mover was found; NaN without any.
        flicker: Share of all sweeps in which a mover is lost that was found before and is after.
        delay_s: Mean time from coming into view until found; one that is never found counts with
            all its time.
    """

    num_movers: int
    num_sweeps: int
    found: float
    flicker: float
    delay_s: float


@dataclass(frozen=True)
class MoverSummary:
    """What a method said of movers on all of its examples. NaN where there is nothing to judge.

    Attributes:
        precision: Share of the points called dynamic that are.
        recall: Share of the dynamic points that are called so.
        iou: Points called dynamic that are, over those that are called so or are.
        ghosts_per_sweep: Mean number of false movers.
        ghost_sweeps: Share of sweeps with a false mover.
        velocity_error_m_s: Median over tracked objects and sweeps.
        direction_error_deg: Likewise.
        after_stop_s: Longest time that an object was called a mover after it had stopped; 0 if
            none of those that stopped was. NaN: nothing stopped in view.
        confidence: Lower limit of a band of confidence to mean confidence, share of points with
            less than 0.1 m of error, and number of points.
        groups: Name of a group of movers to figures; those without movers are missing.
        lost: What lost movers of 0.5 m/s and more up to 50 m, to the number of mover-sweeps.
    """

    precision: float
    recall: float
    iou: float
    ghosts_per_sweep: float
    ghost_sweeps: float
    velocity_error_m_s: float
    direction_error_deg: float
    after_stop_s: float
    confidence: dict[str, tuple[float, float, int]]
    groups: dict[str, GroupSummary]
    lost: dict[str, int]


_ANY: Final = MoverGroup("0.5 m/s and faster, to 50 m")

# Name of the recording, stamp of the sweep and what was said of its movers.
StampedRow = tuple[str, int, MoverRow]
_Run = list[tuple[float, ObjectRow]]


def summarize_movers(rows: Iterable[StampedRow]) -> MoverSummary | None:
    """Returns the figures of a method over all sweeps, in any order; None if there are none."""
    rows = sorted(rows, key=lambda row: row[:2])
    if not rows:
        return None
    right, wrong, missed = np.sum([row.points for _, _, row in rows], axis=0).tolist()
    ghosts = np.array([row.num_ghosts for _, _, row in rows])
    objects = [item for _, _, row in rows for item in row.objects if item.moves]
    runs = _runs(rows)
    groups = {group.name: _group_summary(group, runs) for group in MOVER_GROUPS}
    return MoverSummary(
        precision=_share(right, right + wrong),
        recall=_share(right, right + missed),
        iou=_share(right, right + wrong + missed),
        ghosts_per_sweep=float(ghosts.mean()),
        ghost_sweeps=float((ghosts > 0).mean()),
        velocity_error_m_s=_median([item.velocity_error_m_s for item in objects]),
        direction_error_deg=math.degrees(_median([item.direction_error_rad for item in objects])),
        after_stop_s=float(np.fmax.reduce([_after_stop_s(run) for run in runs], initial=math.nan)),
        confidence=_calibration([row.confidence for _, _, row in rows]),
        groups={name: group for name, group in groups.items() if group is not None},
        lost=dict(
            Counter(
                item.lost_by.value
                for item in objects
                if item.lost_by is not None and _ANY.has(item)
            ).most_common()
        ),
    )


def _runs(rows: Sequence[StampedRow]) -> list[_Run]:
    """Time in seconds and row of each object, apart for each time that it comes into view."""
    runs: list[_Run] = []
    current: dict[tuple[str, int], _Run] = {}
    for recording, stamp_ns, row in rows:
        for item in row.objects:
            key, time_s = (recording, item.object_id), stamp_ns / NANOSECONDS
            run = current.get(key)
            if run is None or time_s - run[-1][0] > _MAX_AWAY_S:
                run = current[key] = []
                runs.append(run)
            run.append((time_s, item))
        for object_id in row.standing:
            key, time_s = (recording, object_id), stamp_ns / NANOSECONDS
            if key in current and time_s - current[key][-1][0] <= _MAX_AWAY_S:
                current[key].append((time_s, ObjectRow(object_id, "", False, 0.0, 0.0, 0, 0.0)))
    return runs


def _group_summary(group: MoverGroup, runs: Iterable[_Run]) -> GroupSummary | None:
    late: list[bool] = []
    delays_s: list[float] = []
    num_sweeps = num_lost = 0
    for run in runs:
        own = [(time_s, item.is_found) for time_s, item in run if group.has(item)]
        if not own:
            continue
        first_s = own[0][0]
        late += [found for time_s, found in own if time_s - first_s >= group.first_s - _TINY_S]
        hits = [place for place, (_, found) in enumerate(own) if found]
        delays_s.append(own[hits[0] if hits else -1][0] - first_s)
        num_sweeps += len(own)
        num_lost += hits[-1] - hits[0] + 1 - len(hits) if hits else 0
    if not delays_s:
        return None
    return GroupSummary(
        num_movers=len(delays_s),
        num_sweeps=len(late),
        found=_share(sum(late), len(late)),
        flicker=num_lost / num_sweeps,
        delay_s=math.fsum(delays_s) / len(delays_s),
    )


def _after_stop_s(run: _Run) -> float:
    """How long an object is called a mover after it stopped; NaN if it never did so."""
    longest_s, stopped_s, has_moved = math.nan, math.nan, False
    for time_s, item in run:
        if item.moves:
            has_moved, stopped_s = True, math.nan
        elif has_moved and item.speed_m_s < STOPPED_M_S:
            stopped_s = time_s if math.isnan(stopped_s) else stopped_s
            longest_s = np.fmax(longest_s, time_s - stopped_s if item.is_found else 0.0)
    return float(longest_s)


def _calibration(
    parts: Iterable[dict[str, list[float]]],
) -> dict[str, tuple[float, float, int]]:
    sums: dict[str, NDArray[np.float64]] = {}
    for part in parts:
        for band, values in part.items():
            sums[band] = sums.get(band, np.zeros(3)) + values
    return {
        band: (float(said / number), float(close / number), int(number))
        for band, (number, said, close) in sorted(sums.items(), key=lambda item: float(item[0]))
    }


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan


def _median(values: Sequence[float]) -> float:
    known = [value for value in values if not math.isnan(value)]
    return float(np.median(known)) if known else math.nan
