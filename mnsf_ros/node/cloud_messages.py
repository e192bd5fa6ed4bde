"""PointCloud2 -> Sweep, and flow -> PointCloud2."""

from __future__ import annotations

from array import array
from dataclasses import asdict, dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from mnsf_ros.core.flow_columns import FLOW_COLUMNS, compact_columns, flow_columns
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.settings import TimeSettings
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.cloud_sweep import decode_cloud
from msg_utils.cdr import serialized_cloud
from msg_utils.cloud_layout import CloudLayout
from msg_utils.point_cloud2 import (
    EncodedCloud,
    clash_names,
    decode_points,
    encoding_of_columns,
    encoding_with_columns,
)
from msg_utils.point_times import PointTimes

_CLASH_PREFIX: Final = "sensor_"


@dataclass(frozen=True)
class CloudSource:
    """The message that a sweep was decoded from."""

    message: PointCloud2
    finite: NDArray[np.bool_]  # (height * width,) the points of the message that are in the sweep
    times: PointTimes


def sweep_from_message(message: PointCloud2, settings: TimeSettings, now_ns: int) -> Sweep:
    """Returns the finite points of a cloud, with a CloudSource as `source`.

    The stamp is `now_ns` if the message has none.

    Raises:
        MessageError: If the message cannot be decoded.
    """
    cloud = decode_cloud(message, settings, now_ns)
    return replace(cloud.sweep, source=CloudSource(message, cloud.finite, cloud.times))


def flow_cloud(
    sweep: Sweep, estimate: FlowEstimate, interval_s: float, *, is_compact: bool
) -> bytes:
    """Returns the cloud that a sweep came from with the columns of its flow, serialized.

    It has the same header, height, width and order, the fields of the cloud, and those of
    FLOW_COLUMNS. A field of the cloud that has the name of one of these is kept as `sensor_...`.
    A compact one has the fields of `compact_columns` only.
    """
    source: CloudSource = sweep.source
    message, measured = source.message, source.finite
    if is_compact:
        columns = compact_columns(sweep.xyz, estimate, measured)
        encoding = encoding_of_columns(columns, message.height, message.width)
    else:
        columns = flow_columns(estimate, interval_s, measured)
        encoding = encoding_with_columns(message, columns, clash_prefix=_CLASH_PREFIX)
    return serialized_cloud(message.header, encoding, is_dense=bool(measured.all()))


def renamed_fields(message: PointCloud2) -> dict[str, str]:
    """Returns old name -> new name of fields of a cloud that `flow_cloud` renames."""
    names = [field.name for field in message.fields]
    return clash_names(names, [column.name for column in FLOW_COLUMNS], _CLASH_PREFIX)


def part_of(
    sweep: Sweep, estimate: FlowEstimate, wanted: NDArray[np.bool_]
) -> tuple[Sweep, FlowEstimate]:
    """Returns the wanted points (N,) of a sweep, with a cloud of one row, and their estimate."""
    source: CloudSource = sweep.source
    chosen = np.flatnonzero(wanted)
    rows = np.flatnonzero(source.finite)[chosen]
    points = np.take(decode_points(source.message).reshape(-1), rows)
    layout = CloudLayout.from_cloud(source.message)
    part = replace(layout, height=1, width=len(rows), row_step=layout.point_step * len(rows))
    message = _message(source.message.header, part, points.tobytes(), is_dense=True)
    own_source = CloudSource(message, np.ones(len(rows), np.bool_), source.times)
    return replace(sweep.part(chosen), source=own_source), estimate.part(chosen)


def encoded_message(header: Header, encoded: EncodedCloud, *, is_dense: bool) -> PointCloud2:
    """Returns the message of an encoded cloud."""
    return _message(header, encoded, encoded.data.data, is_dense=is_dense)


def _message(
    header: Header, layout: CloudLayout, buffer: bytes | memoryview, *, is_dense: bool
) -> PointCloud2:
    data = array("B")
    data.frombytes(buffer)
    message = PointCloud2(
        header=header,
        height=layout.height,
        width=layout.width,
        fields=[PointField(**asdict(field)) for field in layout.fields],
        is_bigendian=layout.is_bigendian,
        point_step=layout.point_step,
        row_step=layout.row_step,
        is_dense=is_dense,
    )
    # Not by the constructor, which would check byte after byte.
    message.data = data
    return message
