# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Header stamp <-> integer nanoseconds."""

from typing import Any, Final, TypeAlias

from msg_utils.errors import INT32_MAX, checked_integer

NANOSECONDS_PER_SECOND: Final = 1_000_000_000
LATEST_STAMP_NS: Final = INT32_MAX * NANOSECONDS_PER_SECOND + NANOSECONDS_PER_SECOND - 1

# Any object with `sec` and `nanosec`, as builtin_interfaces/Time has.
StampLike: TypeAlias = Any


def decode_stamp(stamp: StampLike) -> int:
    """Returns a message's `header.stamp` in nanoseconds since the epoch of the sender's clock.

    A time before the epoch is refused, as rclcpp and rclpy refuse it. `nanosec` of a second or more
    is carried into the seconds, as they do: drivers that round a floating point time send exactly
    1,000,000,000, and the time they mean is not in doubt.

    Raises:
        MessageError: `sec` is no integer from 0 to 2**31 - 1, or `nanosec` none to 2**32 - 1.
    """
    sec = checked_integer(stamp.sec, "stamp.sec", INT32_MAX)
    nanosec = checked_integer(stamp.nanosec, "stamp.nanosec")
    return sec * NANOSECONDS_PER_SECOND + nanosec


def encode_stamp(stamp_ns: int) -> tuple[int, int]:
    """Returns `sec` and `nanosec`, below one second, of nanoseconds since the epoch.

    Raises:
        MessageError: The time is no integer, is before the epoch, or is after January 2038, where
            the seconds of the message overflow.
    """
    checked = checked_integer(stamp_ns, "stamp_ns", LATEST_STAMP_NS)
    return divmod(checked, NANOSECONDS_PER_SECOND)
