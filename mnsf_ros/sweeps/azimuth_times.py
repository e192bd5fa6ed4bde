# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of points and the direction in which a turning lidar looks."""

from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats32

# Of a turn: sweeps have gaps, and some rows begin a little before others.
_MIN_TURN: Final = 0.8
_MAX_TURN: Final = 1.5
# Points that tell how a lidar turns, and the sectors in which they are.
_NUM_SAMPLES: Final = 1000
_NUM_SECTORS: Final = 72
# Length of the mean of the unit vectors between azimuth and time. Lidars that turn have more than
# .97, packets of 10 ms .98, others .3 at most.
_TURNING: Final = 0.9
# Points this far from the direction of their time, in turns, and so many times farther than nine
# tenths of the others, have a wrong time: beams of four real lidars are up to 16 degrees off the
# mean one. In frames up to 4 m from the lens, .4 % of the points of one are, none of others.
_FAR_OFF: Final = 45 / 360
_TIMES_FARTHER: Final = 6.0


@dataclass(frozen=True)
class AzimuthTimes:
    """How a lidar turns, as seen from above.

    Attributes:
        is_clockwise: Whether it turns clockwise.
        start_deg: Azimuth at which a sweep begins and ends.
    """

    is_clockwise: bool
    start_deg: float

    def of(self, xyz: Floats32, interval_s: float) -> Floats32:
        """Returns (N,) seconds from the middle of a sweep to the measurement of points (N, 3)."""
        turns = (np.arctan2(xyz[:, 1], xyz[:, 0]) - np.radians(self.start_deg)) / (2 * np.pi)
        shares = (-turns if self.is_clockwise else turns) % 1.0
        return (interval_s * (shares - 0.5)).astype(np.float32)

    def __str__(self) -> str:
        """Returns the value of the parameter time.field."""
        return f"{'clockwise' if self.is_clockwise else 'counterclockwise'}:{self.start_deg:g}"


class Turn(NamedTuple):
    """Rotation of a lidar during a sweep."""

    duration_s: float  # of a whole turn
    sense: int  # 1: counterclockwise, as seen from above
    start: float  # azimuth at the time 0, in turns

    @classmethod
    def of(cls, turns: NDArray[np.floating], times_s: NDArray[np.floating]) -> "Turn | None":
        """Returns the rotation that azimuths (N,), in turns, and times (N,) fit; None without."""
        if len(times_s) == 0:
            return None
        few, in_order = len(times_s) // 100, np.sort(times_s)
        span_s = float(in_order[-1 - few] - in_order[few]) / 0.98
        if span_s == 0:
            return None
        sectors = np.bincount((turns * _NUM_SECTORS).astype(np.int64) % _NUM_SECTORS) > 0
        rate_hz = np.count_nonzero(sectors) / _NUM_SECTORS / span_s
        angles, turned = np.exp(2j * np.pi * turns), np.exp(2j * np.pi * rate_hz * times_s)
        phases = (angles * turned).mean(), (angles * turned.conj()).mean()
        best = int(np.argmax(np.abs(phases)))
        if abs(phases[best]) < _TURNING:
            return None
        turn = cls(1 / rate_hz, 2 * best - 1, float(np.angle(phases[best])) / (2 * np.pi))
        # Directions without a return make that rate some percent too low.
        off, middle_s = turn.off(turns, times_s), times_s.mean()
        slope_hz = (off * (times_s - middle_s)).sum() / ((times_s - middle_s) ** 2).sum()
        if (exact_hz := float(rate_hz + turn.sense * slope_hz)) < rate_hz / 2:
            return None  # a narrow view, in any order
        start = turn.start + float(off.mean() - slope_hz * middle_s)
        return cls(1 / exact_hz, turn.sense, start)

    def off(
        self, turns: NDArray[np.floating], times_s: NDArray[np.floating]
    ) -> NDArray[np.floating]:
        """Returns (N,) turns from the direction at times (N,) to azimuths (N,), -0.5 to 0.5."""
        rate_hz = self.sense / self.duration_s
        off: NDArray[np.floating] = turns - (rate_hz * times_s + self.start).astype(turns.dtype)
        return off - np.round(off)

    def by_azimuth(self, middle_s: float) -> AzimuthTimes:
        """Returns how it turned, for a sweep with this time in its middle."""
        first = self.start + self.sense * (middle_s / self.duration_s - 0.5)
        return AzimuthTimes(self.sense < 0, round(360 * first) % 360)


def contradicted(xyz: Floats32, times_s: Floats32, *, is_likely: bool) -> Bools:
    """Returns (N,) the points (N, 3) at whose times (N,) a turning lidar looked elsewhere.

    Times that are NaN are contradicted as well, and no others if the lidar does not turn. A sample
    of the points tells whether to look at all of them, unless there are `is_likely` some.
    """
    some = np.arange(0, len(xyz), len(xyz) // _NUM_SAMPLES | 1)  # odd: all columns of an image
    some = some[np.isfinite(times_s[some])]
    turns = _turns_of(xyz[some])
    turn = Turn.of(turns, times_s[some])
    if turn is not None:
        off = np.abs(turn.off(turns, times_s[some]))
        far = max(_FAR_OFF, _TIMES_FARTHER * float(np.sort(off)[-1 - len(off) // 10]))
        if is_likely or off.max() > far:
            return ~(np.abs(turn.off(_turns_of(xyz), times_s)) < far)
    return np.isnan(times_s)


def _turns_of(xyz: Floats32) -> Floats32:
    """Returns (N,) azimuths of points (N, 3), in turns."""
    return np.asarray(np.arctan2(xyz[:, 1], xyz[:, 0]) / np.float32(2 * np.pi), np.float32)


def times_in_order(xyz: Floats32, interval_s: float) -> Floats32 | None:
    """Returns (N,) seconds from the middle of a sweep whose points (N, 3) are in order of azimuth.

    The points go around once, or once for each beam; otherwise the result is None.
    """
    if len(xyz) == 0:
        return None
    azimuths = _turns_of(xyz)
    steps = np.diff(azimuths, prepend=azimuths[:1])
    turns = np.cumsum(steps - np.round(steps), dtype=np.float64)
    if abs(turns[-1]) < _MIN_TURN:
        return None
    shares = turns * np.sign(turns[-1])
    if shares[-1] > _MAX_TURN:
        shares %= 1.0
    return (interval_s * (shares - 0.5)).astype(np.float32)
