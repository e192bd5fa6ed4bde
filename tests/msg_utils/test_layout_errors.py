# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Layouts that contradict themselves: one clear line each, whatever function meets them."""

import re

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points, decode_xyz, encode_with_columns

XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
FUNCTIONS = [
    decode_points,
    decode_xyz,
    lambda cloud: encode_with_columns(cloud, {}, clash_prefix=""),
]


def expect(cloud, text):
    for function in FUNCTIONS:
        with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
            function(cloud)


ROW = {"width": 2, "point_step": 12}
# Neither overflows nor allocates.
HUGE = {"width": 2**31, "height": 2**31, "point_step": 1, "row_step": 2**31}


@pytest.mark.parametrize(
    ("fields", "num_bytes", "layout", "text"),
    [
        (XYZ, 23, ROW, "data has 23 bytes, expected at least 24 (height 1, width 2, point_step"),
        (XYZ, 51, ROW | {"height": 2, "row_step": 28}, "data has 51 bytes, expected at least 52 ("),
        (XYZ, 24, ROW | {"point_step": 0}, "point_step is 0, expected at least 1 for 2 points"),
        (XYZ, 22, ROW | {"point_step": 11}, "field 'z' (offset 8, count 1, FLOAT32) ends at byte"),
        ([("x", 0, 8, 2**32 - 1)], 24, ROW, "field 'x' (offset 0, count 4294967295, FLOAT64) ends"),
        (XYZ, 25, ROW | {"row_step": 23}, "row_step is 23, expected at least 24 (width 2 x point_"),
        ([("x", 0, 2, 1)], 100, HUGE, "data has 100 bytes, expected at least 4611686018427387904"),
    ],
)
def test_contradictions_are_named(make_cloud, fields, num_bytes, layout, text):
    expect(make_cloud(fields, bytes(num_bytes), **layout), text)


@pytest.mark.parametrize(
    ("field", "text"),
    [
        (("x", 0, 0, 1), "datatype of field 'x' is 0, expected one of 1 (INT8), 2 (UINT8), 3"),
        (("x", 0, 300, 1), "datatype of field 'x' is 300, expected an integer from 0 to 255"),
        (("x", -4, 7, 1), "offset of field 'x' is -4, expected an integer from 0 to 4294967295"),
        (("x", 0, 7, 2**32), "count of field 'x' is 4294967296, expected an integer from 0 to 429"),
        ((None, 0, 7, 1), "name of a field is None, expected a string"),
        (("a\nb", 0, 7, -1), "count of field 'a\\nb' is -1, expected an integer from 0"),
        (("b" * 100_000, 0, 7, -1), "count of field 'bbb"),
    ],
    ids=range(7),
)
def test_bad_fields_are_named_in_a_short_line(make_cloud, field, text):
    for function in FUNCTIONS:
        with pytest.raises(MessageError, match=f"^{re.escape(text)}") as caught:
            function(make_cloud([field], bytes(16), width=1, point_step=16))
        assert len(str(caught.value)) < 200


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        ([*XYZ[:2], ("i", 8, 7, 1)], "no field 'z', expected x, y and z; the fields are ['x', 'y'"),
        ([], "no field 'x', expected x, y and z; the fields are []"),
        ([*XYZ[:2], ("z", 8, 5, 1)], "field 'z' is 1 x INT32, expected 1 x FLOAT32 or 1 x FLOAT64"),
        ([("x", 0, 7, 3), *XYZ[1:]], "field 'x' is 3 x FLOAT32, expected 1 x FLOAT32 or 1 x FLO"),
    ],
)
def test_clouds_without_positions_are_refused(make_cloud, fields, text):
    cloud = make_cloud(fields, bytes(12), width=1, point_step=12)
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        decode_xyz(cloud)


@pytest.mark.parametrize("name", ["height", "width", "point_step", "row_step"])
@pytest.mark.parametrize("value", [-1, 2**32, 12.0, "12", None])
def test_values_that_are_no_size(make_cloud, name, value):
    maximum = 2**31 - 1 if name == "point_step" else 2**32 - 1
    cloud = make_cloud(XYZ, bytes(12), point_step=12)
    setattr(cloud, name, value)
    expect(cloud, f"{name} is {value!r}, expected an integer from 0 to {maximum}")


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
