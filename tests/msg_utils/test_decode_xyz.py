# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Positions: one mask for all columns, own memory, and floats that are not finite."""

from __future__ import annotations

import re
import struct

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import decode_points, decode_xyz

NAN, INF = float("nan"), float("inf")
LARGEST = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
XYZ64 = [("x", 0, 8, 1), ("y", 8, 8, 1), ("z", 16, 8, 1)]


def pack(points, code="<fff"):
    return b"".join(struct.pack(code, *point) for point in points)


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_one_mask_for_every_column(stack, is_bigendian):
    order = ">" if is_bigendian else "<"
    rows = [
        (1.0, 2.0, 3.0, 10),
        (NAN, 2.0, 3.0, 11),
        (4.0, INF, 6.0, 12),
        (7.0, 8.0, -INF, 13),
        (INF, -INF, 0.0, 14),
        (-0.5, 0.25, 1e-40, 15),
    ]
    data = pack(rows, f"{order}fffH")
    cloud = stack.make_cloud(
        [*XYZ, ("ring", 12, 4, 1)], data, width=6, point_step=14, is_bigendian=is_bigendian
    )
    for _ in range(2):
        xyz, finite = decode_xyz(cloud)
        assert finite.dtype == np.bool_
        assert finite.tolist() == [True, False, False, False, False, True]
        assert xyz.tolist() == [[1.0, 2.0, 3.0], [-0.5, 0.25, float(np.float32(1e-40))]]
        assert decode_points(cloud)["ring"].reshape(-1)[finite].tolist() == [10, 15]
        assert bytes(cloud.data) == data


@pytest.mark.parametrize("last", [3.0, NAN])
def test_own_memory_in_native_order(stack, last):
    cloud = stack.make_cloud(XYZ, pack([(1.0, 2.0, 3.0), (4, 5, last)]), width=2, point_step=12)
    xyz, finite = decode_xyz(cloud)
    assert xyz.dtype == np.dtype("=f4")
    assert xyz.flags.c_contiguous
    assert xyz.flags.writeable
    assert not np.shares_memory(xyz, np.frombuffer(cloud.data, np.uint8))
    xyz[...] = -1.0
    finite[...] = False
    again, _ = decode_xyz(cloud)
    assert again[0].tolist() == [1.0, 2.0, 3.0]


def test_rows_one_after_the_other(stack):
    rows = [[(0, 0, 0), (0, 1, 0)], [(1, 0, 0), (NAN, 1, 0)], [(2, 0, 0), (2, 1, 0)]]
    data = b"".join(pack(row) + b"\x7f" * 8 for row in rows)
    cloud = stack.make_cloud(XYZ, data, width=2, height=3, point_step=12, row_step=32)
    xyz, finite = decode_xyz(cloud)
    assert finite.tolist() == [True, True, True, False, True, True]
    assert xyz.tolist() == [[0, 0, 0], [0, 1, 0], [1, 0, 0], [2, 0, 0], [2, 1, 0]]


def test_autoware_layout_with_float64_at_offset_27(stack):
    # XYZIRADRT without padding.
    fields = [
        *XYZ,
        ("intensity", 12, 7, 1),
        ("ring", 16, 4, 1),
        ("azimuth", 18, 7, 1),
        ("distance", 22, 7, 1),
        ("return_type", 26, 2, 1),
        ("time_stamp", 27, 8, 1),
    ]
    points = [
        (1.0, 2.0, 3.0, 0.5, 7, 0.25, 4.0, 1, 1_700_000_000.125),
        (-1.0, -2.0, -3.0, 0.75, 8, 0.5, 5.0, 2, 1_700_000_000.25),
    ]
    data = pack(points, "<ffffHffBd")
    assert len(data) == 2 * 35
    cloud = stack.send(stack.make_cloud(fields, data, width=2, point_step=35))
    xyz, finite = decode_xyz(cloud)
    assert xyz.tolist() == [[1.0, 2.0, 3.0], [-1.0, -2.0, -3.0]]
    assert finite.tolist() == [True, True]
    times = decode_points(cloud)["time_stamp"].tolist()
    assert times == [[1_700_000_000.125, 1_700_000_000.25]]


def test_float64_beyond_float32_is_not_finite(stack):
    points = [(1e39, 0.0, 0.0), (0.0, -1e300, 0.0), (LARGEST, 1e-300, 0.1), (0.0, 0.0, NAN)]
    cloud = stack.make_cloud(XYZ64, pack(points, "<ddd"), width=4, point_step=24)
    with np.errstate(all="raise"):
        xyz, finite = decode_xyz(cloud)
    assert finite.tolist() == [False, False, True, False]
    assert xyz.tolist() == [[LARGEST, 0.0, struct.unpack("<f", struct.pack("<f", 0.1))[0]]]


def test_large_finite_values_stay(stack):
    cloud = stack.make_cloud(XYZ, pack([(LARGEST, LARGEST, LARGEST)]), width=1, point_step=12)
    xyz, finite = decode_xyz(cloud)
    assert finite.tolist() == [True]
    assert xyz.tolist() == [[LARGEST] * 3]


def test_a_signalling_nan_is_silent(make_cloud):
    signalling = struct.pack("<Q", 0x7FF0000000000001)
    cloud = make_cloud(XYZ64, signalling * 3, width=1, point_step=24)
    with np.errstate(all="raise"):
        xyz, finite = decode_xyz(cloud)
    assert xyz.shape == (0, 3)
    assert finite.tolist() == [False]


def test_mixed_types_any_order_and_a_repeated_name(make_cloud):
    fields = [("z", 12, 7, 0), ("x", 4, 8, 1), ("x", 12, 7, 1), ("y", 0, 7, 1)]
    data = struct.pack("<fdf", 2.0, 1.0, 3.0)
    xyz, _ = decode_xyz(make_cloud(fields, data, width=1, point_step=16))
    assert xyz.tolist() == [[1.0, 2.0, 3.0]]


def test_all_points_invalid(stack):
    cloud = stack.make_cloud(XYZ, pack([(NAN, 0, 0)] * 3), width=3, point_step=12)
    xyz, finite = decode_xyz(cloud)
    assert xyz.shape == (0, 3)
    assert xyz.dtype == np.float32
    assert finite.tolist() == [False, False, False]


@pytest.mark.parametrize("fields", [XYZ, XYZ[:1], []])
@pytest.mark.parametrize(("height", "width"), [(0, 0), (1, 0), (0, 5)])
def test_empty_clouds(stack, fields, height, width):
    cloud = stack.make_cloud(fields, b"", height=height, width=width, point_step=0)
    xyz, finite = decode_xyz(cloud)
    assert (xyz.shape, xyz.dtype) == ((0, 3), np.float32)
    assert (finite.shape, finite.dtype) == ((0,), np.bool_)


@pytest.mark.parametrize(
    ("fields", "text"),
    [
        (
            [("x", 0, 7, 1), ("y", 4, 7, 1), ("intensity", 8, 7, 1)],
            "no field 'z', expected x, y and z; the fields are ['x', 'y', 'intensity']",
        ),
        ([], "no field 'x', expected x, y and z; the fields are []"),
        (
            [("X", 0, 7, 1), ("", 4, 7, 1)],
            "no field 'x', expected x, y and z; the fields are ['X', '']",
        ),
        (
            [*XYZ[:2], ("z", 8, 5, 1)],
            "field 'z' is 1 x INT32, expected 1 x FLOAT32 or 1 x FLOAT64",
        ),
        (
            [("x", 0, 7, 3), *XYZ[1:]],
            "field 'x' is 3 x FLOAT32, expected 1 x FLOAT32 or 1 x FLOAT64",
        ),
    ],
)
def test_clouds_without_positions_are_refused(stack, fields, text):
    cloud = stack.make_cloud(fields, bytes(12), width=1, point_step=12)
    with pytest.raises(MessageError, match=f"^{re.escape(text)}$"):
        decode_xyz(cloud)
