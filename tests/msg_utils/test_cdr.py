# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Serialized clouds: the bytes that rclpy makes of the same message."""

from array import array
from dataclasses import asdict

import numpy as np
import pytest

from msg_utils.cdr import serialized_cloud
from msg_utils.point_cloud2 import decode_points, encode_columns, encode_with_columns

pytest.importorskip("rclpy.serialization")

from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import PointCloud2, PointField
from std_msgs.msg import Header

RANDOM = np.random.default_rng(0)


def header(frame_id="lidar"):
    made = Header(frame_id=frame_id)
    made.stamp.sec, made.stamp.nanosec = 1_700_000_000, 999_999_999
    return made


def message_of(made, encoding, *, is_dense):
    """The same message, made by hand."""
    message = PointCloud2(
        header=made,
        height=encoding.height,
        width=encoding.width,
        fields=[PointField(**asdict(field)) for field in encoding.fields],
        is_bigendian=encoding.is_bigendian,
        point_step=encoding.point_step,
        row_step=encoding.row_step,
        is_dense=is_dense,
    )
    message.data = array("B", encoding.data.tobytes())
    return message


def columns(number, *names):
    return {name: RANDOM.normal(size=number).astype(np.float32) for name in names}


def assert_same(encoding, *, made=None, is_dense=True):
    made = made or header()
    message = message_of(made, encoding, is_dense=is_dense)
    ours = serialized_cloud(made, encoding, is_dense=is_dense)
    theirs = np.frombuffer(serialize_message(message), np.uint8)
    assert len(ours) == len(theirs)
    # Fast CDR leaves the bytes between values as they were; here they are 0.
    num_before = len(ours) - encoding.num_bytes - 1
    differs = np.frombuffer(ours, np.uint8) != theirs
    assert not differs[num_before:].any()
    assert not np.frombuffer(ours, np.uint8)[differs].any()
    assert np.count_nonzero(differs) <= 3 * (len(encoding.fields) * 2 + 2)
    found = deserialize_message(ours, PointCloud2)
    message.header.frame_id = message.header.frame_id.partition("\0")[0]
    assert found == message
    return found


@pytest.mark.parametrize("frame_id", ["", "a", "ab", "abc", "abcd", "base/lidär", "lidar\0hidden"])
def test_a_name_of_any_length_moves_what_follows_as_rclpy_does(frame_id):
    encoding = encode_columns(columns(7, "x", "y", "z"), 1, 7)
    found = assert_same(encoding, made=header(frame_id))
    # A name ends at a zero, as in rclpy.
    assert found.header.frame_id == frame_id.partition("\0")[0]


@pytest.mark.parametrize("shape", [(0, 0), (1, 0), (1, 1), (3, 5), (1, 10_000), (64, 200)])
@pytest.mark.parametrize("is_dense", [True, False])
def test_clouds_of_any_shape(shape, is_dense):
    number = shape[0] * shape[1]
    encoding = encode_columns(columns(number, "x", "longer_name"), *shape)
    message = assert_same(encoding, is_dense=is_dense)
    assert message.is_dense is is_dense
    assert decode_points(message).shape == shape


def test_a_cloud_of_many_rows_with_padding():
    """Rows of fewer points than are written at once, and wider ones."""
    for height, width in ((200, 37), (3, 5_000)):
        values = RANDOM.normal(size=(height, width + 1)).astype("<f4")
        source = PointCloud2(height=height, width=width, point_step=4, row_step=4 * width + 4)
        source.fields = [PointField(name="x", offset=0, datatype=7, count=1)]
        source.data = array("B", values.tobytes())
        message = assert_same(
            encode_with_columns(source, columns(height * width, "a"), clash_prefix="s_")
        )
        np.testing.assert_array_equal(decode_points(message)["x"], values[:, :-1])
