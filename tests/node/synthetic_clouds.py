# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small clouds of the surfaces of boxes that all move alike, and objects of any kind."""

import itertools

import numpy as np
from moving_boxes import surfaces
from rclpy.serialization import deserialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

from mnsf_ros.core.flow_estimate import OverGround, TrackedObject
from msg_utils.cdr import serialized_cloud
from msg_utils.point_cloud2 import decode_points, encode_columns

INTERVAL_NS = 100_000_000

# What the node adds to a point: name to datatype, each of count 1.
ADDED_FIELDS = {
    **{f"flow_{axis}": PointField.FLOAT32 for axis in "xyz"},
    **{f"v{axis}": PointField.FLOAT32 for axis in "xyz"},
    "dynamic": PointField.UINT8,
    "confidence": PointField.FLOAT32,
    "speed": PointField.FLOAT32,
    "rgb": PointField.FLOAT32,
}
# The byte of `dynamic` is followed by three that align `confidence`.
ADDED_BYTES = 10 * 4


def cloud_message(columns, *, stamp_ns, frame_id="lidar"):
    """A cloud of columns of equal length."""
    num_points = len(next(iter(columns.values())))
    encoding = encode_columns(columns, 1, num_points)
    header = Header(frame_id=frame_id)
    header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, 10**9)
    return deserialize_message(serialized_cloud(header, encoding, is_dense=True), PointCloud2)


def xyz_message(xyz, **options):
    """A cloud of x, y, z and an intensity that numbers the points."""
    columns = {axis: np.ascontiguousarray(xyz[:, index]) for index, axis in enumerate("xyz")}
    columns["intensity"] = np.arange(len(xyz), dtype=np.float32)
    return cloud_message(columns, **options)


class Drive:
    """Sweeps of the moving boxes, in a time that no other drive uses."""

    _starts_s = itertools.count(1_000, 1_000)

    def __init__(self):
        self._start_ns = next(self._starts_s) * 10**9

    def stamp_ns(self, index):
        """Stamp of a sweep by its number."""
        return self._start_ns + round(index * INTERVAL_NS)

    def sweep(self, index, *, num_points=1200, **options):
        """A sweep by its number, which may lie between two others."""
        options = {"stamp_ns": self.stamp_ns(index)} | options
        return xyz_message(surfaces(index, num_points), **options)

    def sweeps(self, *indices, **options):
        """Several sweeps by their numbers."""
        return [self.sweep(index, **options) for index in indices]


def column(message, name):
    """(N,) a field of a cloud."""
    return decode_points(message).ravel()[name]


def flow_columns(message):
    """(N, 3) float32, the flow fields of a cloud."""
    return _columns(message, "flow_")


def velocity_columns(message):
    """(N, 3) float32, the velocity fields of a cloud."""
    return _columns(message, "v")


def xyz_columns(message):
    """(N, 3) float32, the positions of a cloud."""
    return _columns(message, "")


def _columns(message, prefix):
    points = decode_points(message).ravel()
    return np.stack([points[f"{prefix}{axis}"] for axis in "xyz"], axis=1).astype(np.float32)


def tracked(track_id=1, **changes):
    """A car at (10, -2) that drives 5 m/s to the left of the sensor, its heading."""
    values = {
        "center": np.array([10.0, -2.0, 0.5]),
        "size": np.array([4.0, 1.8, 1.5]),
        "yaw": np.pi / 2,
        "velocity": np.array([0.0, 5.0, 0.0]),
        "turn_rate": 0.3,
        "covariance": np.diag([0.01, 0.02, 0.03, 0.1, 0.2, 0.3]),
        "age_s": 2.5,
        "num_points": 120,
    }
    return TrackedObject(track_id=track_id, **values | changes)


def over_ground(num_points=1, **changes):
    """Motion over ground of an estimate: all points and the sensor are static."""
    values = {
        "motion": np.zeros((num_points, 3), np.float32),
        "dynamic": np.zeros(num_points, np.bool_),
        "confidence": np.ones(num_points, np.float32),
        "world_from_sensor": np.eye(4),
        "next_from_current": np.eye(4),
        "source": "registration",
    }
    return OverGround(**values | changes)
