# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds of three kinds: of rclpy, of rosbags, and plain ones for what neither can hold."""

from __future__ import annotations

import array
import struct
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


LETTERS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


@pytest.fixture
def random_cloud(make_cloud):
    """A cloud of random bytes: fields of all types that overlap, padding, either byte order."""

    def make(chance):
        height, width = chance.randint(1, 3), chance.randint(1, 4)
        fields, point_step = [], 1
        for index in range(chance.randint(1, 6)):
            code, count, offset = (chance.randint(*ends) for ends in ((1, 8), (0, 3), (0, 30)))
            size = struct.calcsize(f"<{max(count, 1)}{LETTERS[code]}")
            point_step = max(point_step, offset + size)
            fields.append((f"f{index}", offset, code, count))
        point_step += chance.choice([0, 0, 5])
        row_step = width * point_step + chance.choice([0, 3])
        shape = {"width": width, "height": height, "is_bigendian": chance.random() < 0.5}
        data = chance.randbytes(height * row_step)
        return make_cloud(fields, data, point_step=point_step, row_step=row_step, **shape)

    return make


@pytest.fixture
def bytes_of():
    """Bytes and format of a field of one point in a cloud, or in an encoded one."""

    def bytes_of(cloud, field, row, column):
        text = f"{'>' if cloud.is_bigendian else '<'}{max(field.count, 1)}{LETTERS[field.datatype]}"
        start = row * cloud.row_step + column * cloud.point_step + field.offset
        return bytes(cloud.data)[start : start + struct.calcsize(text)], text

    return bytes_of
