# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Field lists: datatypes, names, counts and offsets, against dtypes written out by hand."""

from __future__ import annotations

import re
from types import SimpleNamespace

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.point_fields import (
    FieldLayout,
    datatype_of,
    decode_field,
    fields_end,
    point_dtype,
)

CODES = [(1, "i1"), (2, "u1"), (3, "i2"), (4, "u2"), (5, "i4"), (6, "u4"), (7, "f4"), (8, "f8")]


def field(name="x", offset=0, datatype=7, count=1):
    return SimpleNamespace(name=name, offset=offset, datatype=datatype, count=count)


@pytest.mark.parametrize(("code", "text"), CODES)
def test_every_datatype_in_both_byte_orders(code, text):
    layout = decode_field(field(datatype=code))
    assert layout == FieldLayout("x", 0, code, 1)
    for is_bigendian, order in ((False, "<"), (True, ">")):
        dtype = point_dtype([layout], 8, is_bigendian=is_bigendian)
        assert dtype["x"] == np.dtype(order + text)
        assert dtype.itemsize == 8
        assert datatype_of(dtype["x"], "x") == code


def test_any_order_gaps_overlap_and_odd_offsets():
    fields = [
        FieldLayout("time", 27, 8, 1),
        FieldLayout("x", 1, 7, 1),
        FieldLayout("rgb", 5, 7, 1),
        FieldLayout("rgba", 5, 6, 1),
        FieldLayout("normal", 9, 7, 3),
    ]
    dtype = point_dtype(fields, 35, is_bigendian=False)
    assert dtype.names == ("time", "x", "rgb", "rgba", "normal")
    assert [dtype.fields[name][1] for name in dtype.names] == [27, 1, 5, 5, 9]
    assert dtype["normal"] == np.dtype(("<f4", (3,)))
    assert dtype.itemsize == 35
    assert fields_end(fields) == 35


def test_count_zero_is_kept_and_read_as_one():
    layout = decode_field(field(count=0))
    assert layout.count == 0
    assert layout.end == 4
    assert point_dtype([layout], 4, is_bigendian=False)["x"] == np.dtype("<f4")


def test_empty_and_repeated_names_become_unique():
    names = ["x", "", "x", "", "x_2", "x", "unnamed_1"]
    fields = [FieldLayout(name, 0, 7, 1) for name in names]
    dtype = point_dtype(fields, 4, is_bigendian=False)
    assert dtype.names == ("x", "unnamed_1_", "x_2_", "unnamed_3", "x_2", "x_5", "unnamed_1")


def test_no_fields():
    assert fields_end([]) == 0
    assert point_dtype([], 16, is_bigendian=False).itemsize == 16


DATATYPES = (
    "1 (INT8), 2 (UINT8), 3 (INT16), 4 (UINT16), 5 (INT32), 6 (UINT32), 7 (FLOAT32), 8 (FLOAT64)"
)


@pytest.mark.parametrize(
    ("changed", "text"),
    [
        ({"datatype": 0}, f"datatype of field 'x' is 0, expected one of {DATATYPES}"),
        ({"datatype": 9}, f"datatype of field 'x' is 9, expected one of {DATATYPES}"),
        ({"datatype": 300}, "datatype of field 'x' is 300, expected an integer from 0 to 255"),
        ({"datatype": b"\x07"}, "datatype of field 'x' is b'\\x07', expected an integer from 0 to"),
        ({"offset": -4}, "offset of field 'x' is -4, expected an integer from 0 to 4294967295"),
        ({"offset": 0.0}, "offset of field 'x' is 0.0, expected an integer from 0 to 4294967295"),
        ({"count": -1}, "count of field 'x' is -1, expected an integer from 0 to 4294967295"),
        ({"count": 2**32}, "count of field 'x' is 4294967296, expected an integer from 0 to 4294"),
        ({"name": None}, "name of a field is None, expected a string"),
        ({"name": "a\nb", "count": -1}, "count of field 'a\\nb' is -1, expected an integer from 0"),
    ],
)
def test_bad_fields_are_refused(changed, text):
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        decode_field(field(**changed))


def test_a_very_long_name_is_shortened_in_the_error():
    with pytest.raises(MessageError, match=r"^count of field 'aaa+\.\.\.a+' is -1") as caught:
        decode_field(field(name="a" * 100_000, count=-1))
    assert len(str(caught.value)) < 200


@pytest.mark.parametrize("scalar", ["f2", "i8", "u8", "?", "c8", "S4", "M8[ns]", "O"])
def test_types_that_no_field_can_have_are_refused(scalar):
    dtype = np.dtype(scalar)
    text = f"column 'speed' is of type {dtype}, expected one of {DATATYPES}"
    with pytest.raises(MessageError, match=f"^{re.escape(text)}$"):
        datatype_of(dtype, "speed")
