# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds of three kinds: of rclpy, of rosbags, and plain ones for what neither can hold."""

from __future__ import annotations

import array
import warnings
from types import SimpleNamespace

import numpy as np
import pytest


def cloud_values(
    fields, data=b"", *, width=1, height=1, point_step=0, row_step=None, is_bigendian=False
):
    """Attributes of a cloud, its fields as tuples; rows without padding unless told."""
    return {
        "height": height,
        "width": width,
        "fields": [
            dict(zip(("name", "offset", "datatype", "count"), field, strict=True))
            for field in fields
        ],
        "is_bigendian": is_bigendian,
        "point_step": point_step,
        "row_step": width * point_step if row_step is None else row_step,
        "data": data,
    }


class RclpyStack:
    """Messages as a node gets them; `data` is an array.array."""

    def __init__(self):
        self._messages = pytest.importorskip("sensor_msgs.msg")
        self._serialization = pytest.importorskip("rclpy.serialization")
        # rclpy loads lark at the first message; from Python 3.11 on it imports a deprecated module.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            pytest.importorskip("rosidl_generator_py")

    def make_cloud(self, fields, data, **layout):
        values = cloud_values(fields, array.array("B", bytes(data)), **layout)
        values["fields"] = [self._messages.PointField(**field) for field in values["fields"]]
        return self._messages.PointCloud2(**values)

    def make_stamp(self, sec, nanosec):
        stamp = self._messages.PointCloud2().header.stamp
        stamp.sec, stamp.nanosec = sec, nanosec
        return stamp

    def send(self, cloud):
        raw = self._serialization.serialize_message(cloud)
        return self._serialization.deserialize_message(raw, self._messages.PointCloud2)


class RosbagsStack:
    """Messages as a bag reader gets them; `data` is a read-only array."""

    def __init__(self):
        typesys = pytest.importorskip("rosbags.typesys")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def _make(self, kind, **values):
        return self._store.types[kind](**values)

    def make_cloud(self, fields, data, **layout):
        values = cloud_values(fields, np.frombuffer(bytes(data), np.uint8), **layout)
        values["fields"] = [
            self._make("sensor_msgs/msg/PointField", **field) for field in values["fields"]
        ]
        header = self._make("std_msgs/msg/Header", stamp=self.make_stamp(1, 2), frame_id="lidar")
        return self._make("sensor_msgs/msg/PointCloud2", header=header, is_dense=False, **values)

    def make_stamp(self, sec, nanosec):
        return self._make("builtin_interfaces/msg/Time", sec=sec, nanosec=nanosec)

    def send(self, cloud):
        raw = self._store.serialize_cdr(cloud, "sensor_msgs/msg/PointCloud2")
        return self._store.deserialize_cdr(raw, "sensor_msgs/msg/PointCloud2")


@pytest.fixture(params=[RclpyStack, RosbagsStack], ids=["rclpy", "rosbags"], scope="session")
def stack(request):
    """One of the two real message stacks."""
    return request.param()


@pytest.fixture
def make_cloud():
    """Build a cloud of any values, also of those that no real message can hold."""

    def make(fields, data=b"", **layout):
        values = cloud_values(fields, data, **layout)
        fields = [SimpleNamespace(**field) for field in values["fields"]]
        return SimpleNamespace(**{**values, "fields": fields})

    return make
