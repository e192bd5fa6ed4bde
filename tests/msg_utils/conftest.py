# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds of three kinds: of rclpy, of rosbags, and a plain class for what neither can hold."""

from __future__ import annotations

import array
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest


@dataclass
class PlainField:
    name: Any
    offset: Any
    datatype: Any
    count: Any


@dataclass
class PlainCloud:
    height: Any
    width: Any
    fields: list[PlainField]
    is_bigendian: Any
    point_step: Any
    row_step: Any
    data: Any


def _row_step(width, point_step, row_step):
    return width * point_step if row_step is None else row_step


def make_plain_cloud(
    fields, data=b"", *, width=1, height=1, point_step=0, row_step=None, is_bigendian=False
):
    return PlainCloud(
        height=height,
        width=width,
        fields=[PlainField(*field) for field in fields],
        is_bigendian=is_bigendian,
        point_step=point_step,
        row_step=_row_step(width, point_step, row_step),
        data=data,
    )


class RclpyStack:
    """Messages as a node gets them; `data` is an array.array."""

    def __init__(self):
        self._messages = pytest.importorskip("sensor_msgs.msg")
        self._serialization = pytest.importorskip("rclpy.serialization")
        # rclpy loads lark at the first message; from Python 3.11 on it imports a deprecated module.
        with warnings.catch_warnings():
            warnings.simplefilter("ignore", DeprecationWarning)
            pytest.importorskip("rosidl_generator_py")

    def make_cloud(
        self, fields, data, *, width, point_step, height=1, row_step=None, is_bigendian=False
    ):
        return self._messages.PointCloud2(
            height=height,
            width=width,
            fields=[
                self._messages.PointField(name=name, offset=offset, datatype=datatype, count=count)
                for name, offset, datatype, count in fields
            ],
            is_bigendian=is_bigendian,
            point_step=point_step,
            row_step=_row_step(width, point_step, row_step),
            data=array.array("B", bytes(data)),
            is_dense=False,
        )

    def make_stamp(self, sec, nanosec):
        cloud = self._messages.PointCloud2()
        cloud.header.stamp.sec = sec
        cloud.header.stamp.nanosec = nanosec
        return cloud.header.stamp

    def send(self, cloud):
        raw = self._serialization.serialize_message(cloud)
        return self._serialization.deserialize_message(raw, self._messages.PointCloud2)


class RosbagsStack:
    """Messages as a bag reader gets them; `data` is a read-only array."""

    def __init__(self):
        typesys = pytest.importorskip("rosbags.typesys")
        self._store = typesys.get_typestore(typesys.Stores.ROS2_JAZZY)

    def _type(self, name):
        return self._store.types[name]

    def make_cloud(
        self, fields, data, *, width, point_step, height=1, row_step=None, is_bigendian=False
    ):
        buffer = np.frombuffer(bytes(data), np.uint8)
        make_field = self._type("sensor_msgs/msg/PointField")
        return self._type("sensor_msgs/msg/PointCloud2")(
            header=self._type("std_msgs/msg/Header")(stamp=self.make_stamp(1, 2), frame_id="lidar"),
            height=height,
            width=width,
            fields=[
                make_field(name=name, offset=offset, datatype=datatype, count=count)
                for name, offset, datatype, count in fields
            ],
            is_bigendian=is_bigendian,
            point_step=point_step,
            row_step=_row_step(width, point_step, row_step),
            data=buffer,
            is_dense=False,
        )

    def make_stamp(self, sec, nanosec):
        return self._type("builtin_interfaces/msg/Time")(sec=sec, nanosec=nanosec)

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
    return make_plain_cloud
