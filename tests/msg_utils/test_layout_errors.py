# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Layouts that contradict themselves: one clear line each, whatever function meets them."""

from __future__ import annotations

import contextlib
import random
import re

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points, decode_xyz, encode_with_columns

XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
FUNCTIONS = [decode_points, decode_xyz, lambda cloud: encode_with_columns(cloud, {})]


def expect(cloud, text):
    for function in FUNCTIONS:
        with pytest.raises(MessageError, match=f"^{re.escape(text)}$"):
            function(cloud)


def test_data_too_short(stack):
    expect(
        stack.make_cloud(XYZ, bytes(23), width=2, point_step=12),
        "data has 23 bytes, expected at least 24 (height 1, width 2, point_step 12, row_step 24)",
    )
    expect(
        stack.make_cloud(XYZ, bytes(51), width=2, height=2, point_step=12, row_step=28),
        "data has 51 bytes, expected at least 52 (height 2, width 2, point_step 12, row_step 28)",
    )


def test_no_bytes_per_point(stack):
    expect(
        stack.make_cloud(XYZ, bytes(24), width=2, point_step=0),
        "point_step is 0, expected at least 1 for the 2 points of a cloud of height 1 and width 2",
    )


def test_field_beyond_the_point(stack):
    expect(
        stack.make_cloud(XYZ, bytes(22), width=2, point_step=11),
        "field 'z' (offset 8, count 1, FLOAT32) ends at byte 12 of the point, "
        "expected at most point_step 11",
    )


def test_huge_count_and_offset(stack):
    expect(
        stack.make_cloud([("x", 0, 8, 2**32 - 1)], bytes(24), width=2, point_step=12),
        "field 'x' (offset 0, count 4294967295, FLOAT64) ends at byte 34359738360 of the point, "
        "expected at most point_step 12",
    )
    expect(
        stack.make_cloud([("x", 2**32 - 1, 7, 0)], bytes(24), width=2, point_step=12),
        "field 'x' (offset 4294967295, count 0, FLOAT32) ends at byte 4294967299 of the point, "
        "expected at most point_step 12",
    )


def test_row_too_short(stack):
    expect(
        stack.make_cloud(XYZ, bytes(24), width=2, point_step=12, row_step=23),
        "row_step is 23, expected at least 24 (width 2 x point_step 12)",
    )


def test_absurd_size(stack):
    # 4.6e18 points: neither overflows nor allocates.
    expect(
        stack.make_cloud(
            [("x", 0, 2, 1)],
            bytes(100),
            width=2**31,
            height=2**31,
            point_step=1,
            row_step=2**31,
        ),
        "data has 100 bytes, expected at least 4611686018427387904 (height 2147483648, "
        "width 2147483648, point_step 1, row_step 2147483648)",
    )
    expect(
        stack.make_cloud(XYZ, b"", width=2**31, height=2**31, point_step=12, row_step=2**32 - 1),
        "row_step is 4294967295, expected at least 25769803776 (width 2147483648 x point_step 12)",
    )


def test_unknown_datatype(stack):
    cloud = stack.make_cloud([*XYZ, ("ring", 12, 11, 1)], bytes(16), width=1, point_step=16)
    for function in FUNCTIONS:
        with pytest.raises(MessageError, match=r"^datatype of field 'ring' is 11, expected"):
            function(cloud)


@pytest.mark.parametrize(
    ("name", "maximum"),
    [
        ("height", 4294967295),
        ("width", 4294967295),
        ("point_step", 2147483647),
        ("row_step", 4294967295),
    ],
)
@pytest.mark.parametrize("value", [-1, 2**32, 12.0, "12", None, np.float32(2.0)])
def test_values_that_are_no_size(make_cloud, name, maximum, value):
    cloud = make_cloud(XYZ, bytes(12), point_step=12)
    setattr(cloud, name, value)
    expect(cloud, f"{name} is {value!r}, expected an integer from 0 to {maximum}")


def test_points_larger_than_numpy_can_address(make_cloud):
    expect(
        make_cloud([("x", 0, 8, 2**29)], width=0, point_step=0),
        "field 'x' (offset 0, count 536870912, FLOAT64) ends at byte 4294967296 of the point, "
        "expected at most 2147483647",
    )
    cloud = make_cloud([("x", 2**31 - 9, 8, 1)], width=0, point_step=0)
    with pytest.raises(MessageError, match=r"^encoded point_step is 2147483652, expected an int"):
        encode_with_columns(cloud, {"speed": np.empty(0, np.float32)})


@pytest.mark.parametrize(
    ("data", "text"),
    [
        ([0] * 12, "data is of type list, expected bytes in one piece: a bytes-like object is "),
        (None, "data is of type NoneType, expected bytes in one piece: a bytes-like object is "),
        (
            np.zeros(24, np.uint8)[::2],
            "data is of type ndarray, expected bytes in one piece: ndarray is not C-contiguous",
        ),
    ],
)
def test_data_that_is_no_buffer(make_cloud, data, text):
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        decode_points(make_cloud(XYZ, data, point_step=12))


def test_random_hostile_layouts_only_raise_message_errors(make_cloud):
    chance = random.Random(11)
    sizes = [0, 1, 2, 4, 12, 16, 48, 2**31 - 1, 2**31, 2**32 - 1, 2**32, 2**64, -1, 1.5, None]
    likely = [0, 1, 2, 4, 12, 16]

    def pick():
        return chance.choice(sizes if chance.random() < 0.3 else likely)

    decoded = 0
    for _ in range(3000):
        cloud = make_cloud(
            [(name, pick(), chance.choice([7, 7, 7, 8, 2, 0]), pick()) for name in ("x", "y", "z")],
            bytes(chance.choice([0, 12, 48, 200])),
            point_step=0,
        )
        cloud.height, cloud.width = pick(), pick()
        cloud.point_step, cloud.row_step = pick(), pick()
        for function in FUNCTIONS:
            with contextlib.suppress(MessageError):
                function(cloud)
                decoded += 1
    assert 100 < decoded < 9000
