"""A cloud of a message as a sweep: the same for the node and for recordings."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.settings import TimeSettings
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.cloud_layout import PointCloudLike
from msg_utils.point_cloud2 import decode_xyz
from msg_utils.point_times import PointTimes, TimeRule, decode_times
from msg_utils.stamps import decode_stamp


@dataclass(frozen=True, eq=False)
class DecodedCloud:
    """What was decoded from a sensor_msgs/PointCloud2.

    Attributes:
        sweep: Its finite points, without a `source`.
        finite: (height * width,) bool, the points of the cloud that are in the sweep.
        times: What the cloud says of the times of these points.
        is_stamped: Whether the cloud has a stamp.
    """

    sweep: Sweep
    finite: NDArray[np.bool_]
    times: PointTimes
    is_stamped: bool


def decode_cloud(message: PointCloudLike, settings: TimeSettings, now_ns: int) -> DecodedCloud:
    """Decodes a cloud; `now_ns` is its stamp if it has none.

    Raises:
        MessageError: If the message cannot be decoded.
    """
    xyz, finite = decode_xyz(message)
    own_stamp_ns = decode_stamp(message.header.stamp)
    stamp_ns = own_stamp_ns or now_ns
    rule = TimeRule(settings.field, settings.unit, settings.stamp)
    times = decode_times(message, finite, stamp_ns, rule)
    sweep = Sweep(xyz, stamp_ns, message.header.frame_id, times_s=times.times_s)
    return DecodedCloud(sweep, finite, times, is_stamped=own_stamp_ns != 0)
