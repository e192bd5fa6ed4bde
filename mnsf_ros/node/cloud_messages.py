"""PointCloud2 -> Sweep, and flow -> PointCloud2."""

from __future__ import annotations

from array import array
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.sweeps.sweep import Sweep
from msg_utils.point_cloud2 import EncodedCloud, decode_points, decode_xyz, encode_with_columns
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


def flow_message(sweep: Sweep, estimate: FlowEstimate, interval_s: float) -> PointCloud2:
    """The cloud that a sweep came from, with what was estimated beside each point.

    Args:
        sweep: A sweep made by `sweep_from_message`.
        estimate: Its flow.
        interval_s: Seconds to the next sweep, for velocities; where it is not positive there
            are none.

    Returns:
        The same header, height, width, order and fields, and
        flow_x, flow_y, flow_z: metres until the next sweep, NaN where the point is not finite;
        vx, vy, vz: metres per second over ground, in the axes of this sweep;
        dynamic: 1 where the point moves over ground;
        confidence: 0 to 1.
        Without the sensor's own motion, the velocities and the confidence are NaN.
    """
    source: CloudSource = sweep.source
    encoded = encode_with_columns(source.message, flow_columns(source, estimate, interval_s))
    return encoded_message(source.message.header, encoded, is_dense=bool(source.finite.all()))


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


def flow_columns(
    source: CloudSource, estimate: FlowEstimate, interval_s: float
) -> dict[str, NDArray[Any]]:
    """The columns that a flow adds to its cloud, for all points of the message."""
    columns: dict[str, NDArray[Any]] = {
        f"flow_{axis}": _spread(source, estimate.flow[:, index], np.nan)
        for index, axis in enumerate("xyz")
    }
    known = estimate.over_ground
    num_points = len(source.finite)
    unknown = np.full(num_points, np.nan, np.float32)
    for index, axis in enumerate("xyz"):
        if known is None or interval_s <= 0:
            columns[f"v{axis}"] = unknown
        else:
            velocity = known.motion[:, index] / np.float32(interval_s)
            columns[f"v{axis}"] = _spread(source, velocity, np.nan)
    if known is None:
        return columns | {"dynamic": np.zeros(num_points, np.uint8), "confidence": unknown}
    return columns | {
        "dynamic": _spread(source, known.dynamic.astype(np.uint8), 0),
        "confidence": _spread(source, known.confidence, np.nan),
    }


def _spread(source: CloudSource, values: NDArray[Any], missing: float) -> NDArray[Any]:
    """Values (N,) of the finite points, for all points of the message."""
    if source.finite.all():
        return np.ascontiguousarray(values)
    spread = np.full(len(source.finite), missing, dtype=values.dtype)
    spread[source.finite] = values
    return spread


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
