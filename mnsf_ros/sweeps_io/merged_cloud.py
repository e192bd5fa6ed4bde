# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of several lidars as one sweep in a common frame, with a cloud of its own."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.geometry.transforms import apply
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudSource
from msg_utils.cloud_layout import EncodedCloud
from msg_utils.point_cloud2 import decode_points, encode_columns
from msg_utils.point_times import PointTimes


@dataclass(frozen=True, eq=False)
class MergedCloud(EncodedCloud):
    """Cloud with the attributes of a sensor_msgs/PointCloud2."""

    header: Any


def merged_sweep(
    sweeps: Mapping[int, Sweep],
    frame_from_lidar: Mapping[int, NDArray[np.float64]],
    stamp_ns: int,
    header: Any,  # noqa: ANN401 - std_msgs/Header
) -> Sweep:
    """Returns the points of all sweeps in one frame, with a CloudSource as `source`.

    Fields of its cloud: x, y, z, `intensity` if all lidars have it, `time` (seconds after the
    stamp) unless all points have the same time, and `lidar`, counted from 1.

    Args:
        sweeps: Number of the lidar, from 0, to its sweep, whose `source` is a CloudSource.
        frame_from_lidar: Number of the lidar to its pose (4, 4) in the common frame.
        stamp_ns: Stamp of the merged sweep.
        header: Header of its cloud, with the name of the common frame.
    """
    xyz = np.concatenate(
        [
            apply(frame_from_lidar[index], sweep.xyz).astype(np.float32)
            for index, sweep in sweeps.items()
        ]
    )
    columns: dict[str, NDArray[Any]] = {
        axis: np.ascontiguousarray(xyz[:, number]) for number, axis in enumerate("xyz")
    }
    intensities = [values for sweep in sweeps.values() if (values := _intensity(sweep)) is not None]
    if len(intensities) == len(sweeps):
        columns["intensity"] = np.concatenate(intensities)
    times_s = _times_s(list(sweeps.values()), stamp_ns)
    if times_s is not None:
        columns["time"] = times_s
    numbers = np.fromiter((index + 1 for index in sweeps), np.uint8, len(sweeps))
    columns["lidar"] = np.repeat(numbers, [len(sweep) for sweep in sweeps.values()])
    encoded = encode_columns(columns, 1, len(xyz))
    times = PointTimes(times_s, "several lidars")
    cloud = MergedCloud(**vars(encoded), header=header)
    source = CloudSource(cloud, np.ones(len(xyz), np.bool_), times)
    return Sweep(xyz, stamp_ns, header.frame_id, source=source, times_s=times_s)


def _times_s(sweeps: list[Sweep], stamp_ns: int) -> NDArray[np.float32] | None:
    """(N,) seconds after the common stamp; None if all points were measured at that stamp.

    Points of a sweep without times were measured at its own stamp.
    """
    if all(sweep.times_s is None and sweep.stamp_ns == stamp_ns for sweep in sweeps):
        return None
    parts = [
        (np.zeros(len(sweep)) if sweep.times_s is None else sweep.times_s.astype(np.float64))
        + (sweep.stamp_ns - stamp_ns) / NANOSECONDS
        for sweep in sweeps
    ]
    return np.concatenate(parts).astype(np.float32)


def _intensity(sweep: Sweep) -> NDArray[np.float32] | None:
    """(N,) values of the field; None unless the cloud has one number for each point."""
    source: CloudSource = sweep.source
    points = decode_points(source.message).reshape(-1)
    if "intensity" not in (points.dtype.names or ()) or points["intensity"].ndim != 1:
        return None
    return np.compress(source.finite, points["intensity"]).astype(np.float32)
