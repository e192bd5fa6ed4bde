# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds as messages: encoded ones, and parts of sweeps."""

from __future__ import annotations

from array import array
from dataclasses import asdict, replace

import numpy as np
from numpy.typing import NDArray
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudSource
from msg_utils.cloud_layout import CloudLayout
from msg_utils.point_cloud2 import EncodedCloud, decode_points


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
