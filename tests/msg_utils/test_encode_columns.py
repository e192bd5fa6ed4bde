# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds from columns alone; bytes compared with struct. Columns that no cloud can hold."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_xyz, encode_columns, encode_with_columns
from msg_utils.point_fields import FieldLayout

NAN = float("nan")


def floats(*values):
    return np.array(values, np.float32)


def test_columns_alone_are_packed_in_their_order(stack):
    columns = {
        "x": floats(1, 4),
        "y": floats(2, 5),
        "z": floats(3, NAN),
        "intensity": np.array([7, 8], np.uint8),
        "ring": np.array([513, 9], np.uint16),
        "time": np.array([0.1, 0.2]),
    }
    encoded = encode_columns(columns, 2, 1)
    assert encoded.fields == (
        FieldLayout("x", 0, 7, 1),
        FieldLayout("y", 4, 7, 1),
        FieldLayout("z", 8, 7, 1),
        FieldLayout("intensity", 12, 2, 1),
        FieldLayout("ring", 13, 4, 1),
        FieldLayout("time", 15, 8, 1),
    )
    assert (encoded.height, encoded.width, encoded.is_bigendian) == (2, 1, False)
    assert (encoded.point_step, encoded.row_step) == (23, 23)
    first = struct.pack("<fffBHd", 1, 2, 3, 7, 513, 0.1)
    second = struct.pack("<fffBHd", 4, 5, NAN, 8, 9, 0.2)
    assert encoded.data.tobytes() == first + second
    fields = [(field.name, field.offset, field.datatype, field.count) for field in encoded.fields]
    cloud = stack.make_cloud(fields, encoded.data, width=1, height=2, point_step=23)
    xyz, finite = decode_xyz(stack.send(cloud))
    assert xyz.tolist() == [[1.0, 2.0, 3.0]]
    assert finite.tolist() == [True, False]


def test_all_column_types(make_cloud):
    codes = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}
    encoded = encode_columns({text: np.ones(1, text) for text in codes}, 1, 1)
    assert {field.name: field.datatype for field in encoded.fields} == codes
    assert encoded.data.tobytes() == struct.pack("<bBhHiIfd", *[1] * 8)


def test_columns_alone_for_an_empty_cloud():
    encoded = encode_columns(dict.fromkeys("xyz", floats()), 1, 0)
    assert (encoded.point_step, encoded.row_step, encoded.data.size) == (12, 0, 0)
    assert encode_columns({}, 0, 0).fields == ()


@pytest.mark.parametrize(
    ("columns", "text"),
    [
        ({"speed": floats(1)}, "column 'speed' has shape (1,), expected (2,)"),
        ({"speed": np.ones((2, 1))}, "column 'speed' has shape (2, 1), expected (2,)"),
        ({"speed": np.float32(1.0)}, "column 'speed' is of type float32, expected a NumPy array"),
        ({"speed": [1.0, 2.0]}, "column 'speed' is of type list, expected a NumPy array"),
        ({"ok": np.ones(2, bool)}, "column 'ok' is of type bool, expected one of 1 (INT8), 2 (UIN"),
        ({"": floats(1, 2)}, "name of a column is '', expected a string that is not empty"),
        ({3: floats(1, 2)}, "name of a column is 3, expected a string that is not empty"),
        ({}, "no fields, expected at least one for 2 points"),
    ],
)
def test_columns_that_do_not_fit_are_refused(make_cloud, columns, text):
    cloud = make_cloud([], bytes(8), width=2, point_step=4)
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        encode_with_columns(cloud, columns)
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        encode_columns(columns, 2, 1)


def test_sizes_that_no_message_can_state_are_refused():
    with pytest.raises(
        MessageError, match=r"^width is -1, expected an integer from 0 to 4294967295$"
    ):
        encode_columns({}, 1, -1)
    with pytest.raises(MessageError, match=r"^height is 1\.5, expected an integer"):
        encode_columns({}, 1.5, 1)
    text = "encoded row_step is 17179869180, expected an integer from 0 to 4294967295"
    with pytest.raises(MessageError, match=f"^{text}$"):
        encode_columns({"x": floats()}, 0, 2**32 - 1)
    text = "column 'x' has shape (1,), expected (4611686018427387904,)"
    with pytest.raises(MessageError, match=f"^{re.escape(text)}$"):
        encode_columns({"x": floats(1)}, 2**31, 2**31)


def test_the_result_cannot_be_reassigned():
    encoded = encode_columns({"x": floats(1)}, 1, 1)
    with pytest.raises(AttributeError, match="cannot assign to field 'width'"):
        encoded.width = 2
