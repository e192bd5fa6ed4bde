"""PointCloud2 -> Sweep, and flow -> PointCloud2."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from mnsf_ros.core.flow_columns import FLOW_COLUMNS, flow_columns
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.point_cloud2 import (
    EncodedCloud,
    clash_names,
    decode_points,
    decode_xyz,
    encode_with_columns,
)
from msg_utils.stamps import decode_stamp

_CLASH_PREFIX: Final = "sensor_"


@dataclass(frozen=True)
class CloudSource:
    """The message that a sweep was decoded from.

    Attributes:
        message: The message, unchanged.
        finite: (height * width,) bool, the points of the message that are in the sweep.
    """

    message: PointCloud2
    finite: NDArray[np.bool_]


def sweep_from_message(message: PointCloud2, now_ns: int) -> Sweep:
    """Decodes a cloud.

    Args:
        message: The cloud.
        now_ns: Taken as the sweep's stamp if the message has none.

    Returns:
        The finite points; `source` is a CloudSource.

    Raises:
        MessageError: If the message cannot be decoded.
    """
    xyz, finite = decode_xyz(message)
    return Sweep(
        xyz=xyz,
        stamp_ns=decode_stamp(message.header.stamp) or now_ns,
        frame_id=message.header.frame_id,
        source=CloudSource(message, finite),
    )


def flow_message(sweep: Sweep, estimate: FlowEstimate, interval_s: float) -> PointCloud2:
    """Returns the cloud that a sweep came from, with the columns of the estimate.

    Args:
        sweep: A sweep made by `sweep_from_message`.
        estimate: Its flow.
        interval_s: Seconds to the next sweep.

    Returns:
        The same header, height, width, order and fields, and the fields of FLOW_COLUMNS. A field
        of the cloud that has the name of one of these is kept as `sensor_...`.
    """
    source: CloudSource = sweep.source
    columns = flow_columns(estimate, interval_s, source.finite)
    encoded = encode_with_columns(source.message, columns, clash_prefix=_CLASH_PREFIX)
    return encoded_message(source.message.header, encoded, is_dense=bool(source.finite.all()))


def renamed_fields(message: PointCloud2) -> dict[str, str]:
    """Returns old name -> new name of fields of a cloud that `flow_message` renames."""
    names = [field.name for field in message.fields]
    return clash_names(names, [column.name for column in FLOW_COLUMNS], _CLASH_PREFIX)


def part_message(sweep: Sweep, flow_message: PointCloud2, wanted: NDArray[np.bool_]) -> PointCloud2:
    """Some points of a flow cloud, as a cloud of one row.

    Args:
        sweep: The sweep of the flow.
        flow_message: Its cloud.
        wanted: (N,) bool, the points of the sweep to take.
    """
    source: CloudSource = sweep.source
    points = decode_points(flow_message).reshape(-1)[np.flatnonzero(source.finite)[wanted]]
    data = array("B")
    data.frombytes(points.tobytes())
    message = PointCloud2(
        header=flow_message.header,
        height=1,
        width=len(points),
        fields=flow_message.fields,
        is_bigendian=flow_message.is_bigendian,
        point_step=flow_message.point_step,
        row_step=flow_message.point_step * len(points),
        is_dense=True,
    )
    message.data = data
    return message


def encoded_message(header: Header, encoded: EncodedCloud, *, is_dense: bool) -> PointCloud2:
    """The message of an encoded cloud."""
    data = array("B")
    data.frombytes(encoded.data.data)
    message = PointCloud2(
        header=header,
        height=encoded.height,
        width=encoded.width,
        fields=[
            PointField(name=item.name, offset=item.offset, datatype=item.datatype, count=item.count)
            for item in encoded.fields
        ],
        is_bigendian=encoded.is_bigendian,
        point_step=encoded.point_step,
        row_step=encoded.row_step,
        is_dense=is_dense,
    )
    message.data = data
    return message
