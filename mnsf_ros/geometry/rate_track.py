# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Recent turn rates of a gyroscope, and those around a sweep."""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.stamped_track import StampedTrack
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp

# Any object with the attributes of sensor_msgs/Imu.
ImuLike: TypeAlias = Any

_MAX_RATES: Final = 4000
# As long as no method bridges, and no lidar takes for a sweep.
_BEFORE_NS: Final = 1_000_000_000
_SECOND_NS: Final = 1e9
# No gyroscope measures more, in any unit.
_MAX_RATE: Final = 1e4
# Between rates farther apart, and so long after the last one, the rotation is unknown: a robot that
# begins to turn with 3 rad/s² would be 0.2 degrees off.
MAX_GAP_S: Final = 0.05


@dataclass(frozen=True, eq=False)
class StampedRate:
    """The turn rate of an IMU at a time.

    Attributes:
        stamp_ns: Integer nanoseconds.
        rate: (3,) float64, rad/s about the axes of the IMU.
        frame_id: Name of its frame.
    """

    stamp_ns: int
    rate: NDArray[np.float64]
    frame_id: str = ""

    @classmethod
    def of(cls, message: ImuLike) -> "StampedRate":
        """Returns the rate of a sensor_msgs/Imu; its orientation and acceleration are not used.

        Raises:
            MessageError: It has no stamp, measures no rates, or has rates that cannot be.
        """
        stamp_ns = decode_stamp(message.header.stamp)
        if stamp_ns == 0:
            raise MessageError("no stamp, expected the time of the rates")
        if message.angular_velocity_covariance[0] == -1:
            raise MessageError("no turn rates (angular_velocity_covariance[0] is -1)")
        rate = message.angular_velocity
        values = np.array([rate.x, rate.y, rate.z], dtype=np.float64)
        if not (np.abs(values) < _MAX_RATE).all():
            raise MessageError(f"invalid turn rates {values.tolist()}, expected rad/s")
        return cls(stamp_ns, values, message.header.frame_id)


class RateTrack(StampedTrack[StampedRate]):
    """The last 4000 turn rates of one IMU."""

    def __init__(self, recorded: Iterable[StampedRate | None] = ()) -> None:
        """Starts without rates; recorded ones are read on the way, None where some are missing."""
        super().__init__(recorded, _MAX_RATES)

    @property
    def rate_hz(self) -> float:
        """Mean number of rates a second; 0 if unknown."""
        if len(self._items) < 2:
            return 0.0
        span_ns = self._items[-1].stamp_ns - self._items[0].stamp_ns
        return (len(self._items) - 1) / (span_ns / _SECOND_NS)

    @property
    def frame_id(self) -> str:
        """Frame of the rates; empty without any."""
        return self._items[-1].frame_id if self._items else ""

    def add(self, item: StampedRate) -> bool:
        """Adds rates, see `StampedTrack.add`. Those of another frame replace all before."""
        if item.frame_id != self.frame_id:
            self._items.clear()
        return super().add(item)

    def around(self, stamp_ns: int, end_ns: int) -> NDArray[np.float64]:
        """Returns the rates from a second before a stamp to an end: (K, 4), K may be 0.

        Columns are seconds from the stamp, and rad/s about the axes of the IMU. One more row may
        be after the end.
        """
        self.read_until(end_ns)
        first_ns = stamp_ns - _BEFORE_NS
        rows = []
        for item in self._items:
            if item.stamp_ns >= first_ns:
                rows.append(((item.stamp_ns - stamp_ns) / _SECOND_NS, *item.rate))
                if item.stamp_ns >= end_ns:
                    break
        return np.array(rows, dtype=np.float64).reshape(-1, 4)


def are_covered(rates: NDArray[np.float64], first_s: float, last_s: float) -> bool:
    """Returns whether rates (K, 4), as of `RateTrack.around`, tell the rotation between times."""
    times_s = rates[:, 0]
    begin, end = np.searchsorted(times_s, first_s, "right") - 1, np.searchsorted(times_s, last_s)
    if begin < 0:
        return False
    # The last gap is below 0 if rates come after the last time.
    gaps_s = np.diff(np.append(times_s[begin : end + 1], last_s))
    return bool(gaps_s.max() <= MAX_GAP_S)
