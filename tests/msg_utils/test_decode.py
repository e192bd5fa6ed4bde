# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Decoded clouds: values against struct, one mask for all columns, memory, and odd layouts."""

import array
import random
import struct

import numpy as np
import pytest

from msg_utils.point_cloud2 import decode_points, decode_xyz

NAN, INF = float("nan"), float("inf")
LARGEST = struct.unpack("<f", b"\xff\xff\x7f\x7f")[0]
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]
XYZ64 = [("x", 0, 8, 1), ("y", 8, 8, 1), ("z", 16, 8, 1)]


def pack(points, code="<fff"):
    return b"".join(struct.pack(code, *point) for point in points)


class TestPoints:
    def test_several_elements_overlap_and_repeated_names(self, make_cloud):
        data = struct.pack("<6f", *range(1, 7))
        fields = [("normal", 0, 7, 3), ("y", 4, 7, 1), ("y", 8, 7, 1), ("", 0, 7, 1)]
        fields += [("z", 8, 7, 0), ("unnamed_3", 0, 7, 1)]
        points = decode_points(make_cloud(fields, data, width=2, point_step=12))
        assert points["normal"].tolist() == [[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]]
        assert points["y"].tolist() == [[2.0, 5.0]]
        assert points["y_2"].tolist() == [[3.0, 6.0]]
        assert points["unnamed_3_"].tolist() == points["unnamed_3"].tolist() == [[1.0, 4.0]]
        assert points["z"].tolist() == [[3.0, 6.0]]

    @pytest.mark.parametrize(
        "hold",
        [bytes, bytearray, memoryview, lambda data: array.array("B", data)],
        ids=["bytes", "bytearray", "memoryview", "array"],
    )
    def test_is_a_read_only_view_of_any_kind_of_data(self, make_cloud, hold):
        data = hold(struct.pack("<fff", 1.0, 2.0, 3.0))
        points = decode_points(make_cloud([("x", 0, 7, 1)], data, width=3, point_step=4))
        assert points["x"].tolist() == [[1.0, 2.0, 3.0]]
        assert np.shares_memory(points, np.frombuffer(data, np.uint8))
        with pytest.raises(ValueError, match="read-only"):
            points["x"][0, 0] = 5.0

    @pytest.mark.parametrize(("height", "width"), [(0, 0), (0, 7), (1, 0), (2**32 - 1, 0)])
    @pytest.mark.parametrize("fields", [[("x", 0, 7, 1), ("time", 4, 8, 1)], []])
    def test_empty_clouds(self, make_cloud, fields, height, width):
        for point_step in (0, 12, 32):
            cloud = make_cloud(
                fields, b"", height=height, width=width, point_step=point_step, row_step=0
            )
            assert decode_points(cloud).shape == (height, width)
            xyz, finite = decode_xyz(cloud)
            assert (xyz.shape, xyz.dtype, finite.shape) == ((0, 3), np.float32, (0,))

    def test_more_data_than_needed_and_no_padding_after_the_last_row(self, make_cloud):
        row, fields = struct.pack("<ff", 1.0, 2.0), [("x", 0, 7, 1)]
        longer = make_cloud(fields, row + b"rest", width=2, point_step=4)
        assert decode_points(longer)["x"].tolist() == [[1.0, 2.0]]
        two = row + b"\xff" * 4 + row
        shorter = make_cloud(fields, two, width=2, height=2, point_step=4, row_step=12)
        assert decode_points(shorter)["x"].tolist() == [[1.0, 2.0], [1.0, 2.0]]

    def test_random_layouts_against_struct(self, random_cloud, bytes_of):
        chance = random.Random(5)
        for _ in range(60):
            cloud = random_cloud(chance)
            points = decode_points(cloud)
            for field in cloud.fields:
                for row, column in np.ndindex(points.shape):
                    packed, text = bytes_of(cloud, field, row, column)
                    found = np.atleast_1d(points[field.name][row, column])
                    np.testing.assert_array_equal(found, struct.unpack(text, packed))


class TestXyz:
    @pytest.mark.parametrize("is_bigendian", [False, True])
    def test_one_mask_for_every_column(self, make_cloud, is_bigendian):
        rows = [
            (1.0, 2.0, 3.0, 10),
            (NAN, 2.0, 3.0, 11),
            (4.0, INF, 6.0, 12),
            (7.0, 8.0, -INF, 13),
            (-0.5, 0.25, 1e-40, 15),
            (0.0, -0.0, 0.0, 16),
            (0.0, 0.0, 1.0, 17),
        ]
        data = pack(rows, f"{'>' if is_bigendian else '<'}fffH")
        fields = [*XYZ, ("ring", 12, 4, 1)]
        cloud = make_cloud(fields, data, width=7, point_step=14, is_bigendian=is_bigendian)
        xyz, measured = decode_xyz(cloud)
        assert measured.tolist() == [True, False, False, False, True, False, True]
        least = float(np.float32(1e-40))
        assert xyz.tolist() == [[1.0, 2.0, 3.0], [-0.5, 0.25, least], [0.0, 0.0, 1.0]]
        assert decode_points(cloud)["ring"].reshape(-1)[measured].tolist() == [10, 15, 17]
        assert bytes(cloud.data) == data
        # The positions are of their own memory, also where none is left out.
        for part in (cloud, make_cloud(XYZ, pack([(1, 2, 3)]), width=1, point_step=12)):
            xyz, _ = decode_xyz(part)
            assert xyz.dtype == np.dtype("=f4")
            assert xyz.flags.c_contiguous
            assert xyz.flags.writeable
            assert not np.shares_memory(xyz, np.frombuffer(part.data, np.uint8))

    def test_float64_beyond_float32_and_signalling_nan_are_silent(self, make_cloud):
        points = [(1e39, 0.0, 0.0), (0.0, -1e300, 0.0), (LARGEST, 1e-300, 0.1)]
        data = pack(points, "<ddd") + struct.pack("<Q", 0x7FF0000000000001) * 3
        with np.errstate(all="raise"):
            xyz, finite = decode_xyz(make_cloud(XYZ64, data, width=4, point_step=24))
        assert finite.tolist() == [False, False, True, False]
        assert xyz.tolist() == [[LARGEST, 0.0, float(np.float32(0.1))]]

    def test_mixed_types_any_order_and_a_repeated_name(self, make_cloud):
        fields = [("z", 12, 7, 0), ("x", 4, 8, 1), ("x", 12, 7, 1), ("y", 0, 7, 1)]
        data = struct.pack("<fdf", 2.0, 1.0, 3.0)
        xyz, _ = decode_xyz(make_cloud(fields, data, width=1, point_step=16))
        assert xyz.tolist() == [[1.0, 2.0, 3.0]]


@pytest.mark.parametrize("row_step", [0, 2, 72, 96])
@pytest.mark.parametrize("shape", [(1, 6), (3, 2)])
def test_exact_data_decides_where_row_step_contradicts_it(make_cloud, shape, row_step):
    xyz = np.arange(18, dtype="<f4").reshape(6, 3)
    fields = [(name, 4 * index, 7, 1) for index, name in enumerate("xyz")]
    height, width = shape
    cloud = make_cloud(
        fields, xyz.tobytes(), height=height, width=width, point_step=12, row_step=row_step
    )
    np.testing.assert_array_equal(decode_xyz(cloud)[0], xyz)
