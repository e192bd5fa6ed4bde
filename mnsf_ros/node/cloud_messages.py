"""PointCloud2 -> Sweep, and flow -> PointCloud2."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField

from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.point_cloud2 import decode_xyz, encode_with_columns
from msg_utils.stamps import decode_stamp


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


def flow_message(sweep: Sweep, flow: NDArray[np.float32]) -> PointCloud2:
    """The cloud that a sweep came from, with its flow beside each point.

    Args:
        sweep: A sweep made by `sweep_from_message`.
        flow: (N, 3) metres until the next sweep.

    Returns:
        The same header, height, width, order and fields, and flow_x, flow_y, flow_z; NaN where
        the point itself is not finite.
    """
    source: CloudSource = sweep.source
    all_flow = np.full((len(source.finite), 3), np.nan, dtype=np.float32)
    all_flow[source.finite] = flow
    columns: dict[str, NDArray[Any]] = {
        f"flow_{axis}": all_flow[:, index] for index, axis in enumerate("xyz")
    }
    encoded = encode_with_columns(source.message, columns)
    data = array("B")
    data.frombytes(encoded.data.data)
    message = PointCloud2(
        header=source.message.header,
        height=encoded.height,
        width=encoded.width,
        fields=[
            PointField(name=item.name, offset=item.offset, datatype=item.datatype, count=item.count)
            for item in encoded.fields
        ],
        is_bigendian=encoded.is_bigendian,
        point_step=encoded.point_step,
        row_step=encoded.row_step,
        is_dense=bool(source.finite.all() and np.isfinite(flow).all()),
    )
    message.data = data
    return message
