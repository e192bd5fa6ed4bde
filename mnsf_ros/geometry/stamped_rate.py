# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The turn rate of an IMU at a time."""

from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from mnsf_ros.arrays import Floats
from msg_utils.errors import MessageError
from msg_utils.stamps import decode_stamp

# Any object with the attributes of sensor_msgs/Imu.
ImuLike: TypeAlias = Any

# No gyroscope measures more, in any unit.
_MAX_RATE: Final = 1e4


@dataclass(frozen=True, eq=False)
class StampedRate:
    """The turn rate of an IMU at a time."""

    stamp_ns: int
    rate: Floats  # (3,) rad/s about the axes of the IMU
    frame_id: str = ""  # name of its frame

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
