# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""PointCloud2 -> Sweep, and flow -> PointCloud2: the same for messages of ROS and of recordings."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_columns import chosen_columns, flow_columns, position_columns
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.settings import OutputSettings, TimeSettings
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.cdr import serialized_cloud
from msg_utils.cloud_layout import PointCloudLike
from msg_utils.point_cloud2 import (
    clash_names,
    decode_xyz,
    encoding_of_columns,
    encoding_with_columns,
)
from msg_utils.point_times import PointTimes, TimeRule, decode_times
from msg_utils.stamps import decode_stamp

_CLASH_PREFIX: Final = "sensor_"


@dataclass(frozen=True, eq=False)
class CloudSource:
    """The cloud that a sweep was decoded from.

    Attributes:
        message: A sensor_msgs/PointCloud2, or what has its attributes.
        finite: (height * width,) bool, the points of the message that are in the sweep.
        times: What the cloud says of the times of these points.
        is_stamped: Whether the message has a stamp.
    """

    message: Any
    finite: NDArray[np.bool_]
    times: PointTimes
    is_stamped: bool = True


def sweep_from_message(message: PointCloudLike, settings: TimeSettings, now_ns: int) -> Sweep:
    """Returns the finite points of a cloud, with a CloudSource as `source`.

    The stamp is `now_ns` if the message has none.

    Raises:
        MessageError: If the message cannot be decoded.
    """
    xyz, finite = decode_xyz(message)
    own_stamp_ns = decode_stamp(message.header.stamp)
    stamp_ns = own_stamp_ns or now_ns
    rule = TimeRule(settings.field, settings.unit, settings.stamp)
    times = decode_times(message, finite, stamp_ns, rule)
    source = CloudSource(message, finite, times, is_stamped=own_stamp_ns != 0)
    return Sweep(xyz, stamp_ns, message.header.frame_id, source=source, times_s=times.times_s)


def flow_cloud(
    sweep: Sweep, estimate: FlowEstimate, interval_s: float, output: OutputSettings
) -> bytes:
    """Returns the cloud that a sweep came from with the columns of its flow, serialized.

    It has the same header, height, width and order, the fields of the cloud, and those of
    FLOW_COLUMNS. A field of the cloud that has the name of one of these is kept as `sensor_...`.
    A compact one has no field of the cloud but x, y and z.
    """
    source: CloudSource = sweep.source
    message, measured = source.message, source.finite
    columns = flow_columns(estimate, interval_s, measured, chosen_columns(output))
    if output.layout == "compact":
        columns = position_columns(sweep.xyz, measured) | columns
        encoding = encoding_of_columns(columns, message.height, message.width)
    else:
        encoding = encoding_with_columns(message, columns, clash_prefix=_CLASH_PREFIX)
    return serialized_cloud(message.header, encoding, is_dense=bool(measured.all()))


def renamed_fields(message: PointCloudLike, output: OutputSettings) -> dict[str, str]:
    """Returns old name -> new name of fields of a cloud that `flow_cloud` renames."""
    if output.layout == "compact":
        return {}
    names = [field.name for field in message.fields]
    return clash_names(names, [column.name for column in chosen_columns(output)], _CLASH_PREFIX)
