# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Encoded clouds, of columns alone or of another cloud with columns; bytes against struct."""

import random
import re
import struct
from dataclasses import asdict

import numpy as np
import pytest

from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import (
    clash_names,
    decode_points,
    decode_xyz,
    encode_columns,
    encode_with_columns,
)

NAN = float("nan")
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]


def encoded_with(cloud, columns):
    return encode_with_columns(cloud, columns, clash_prefix="my_")


def as_tuples(encoded):
    return [(field.name, field.offset, field.datatype, field.count) for field in encoded.fields]


def floats(*values):
    return np.array(values, np.float32)


def flow(*values):
    return {"flow_x": floats(*values), "flow_y": -floats(*values), "flow_z": floats(*values) * 2}


def flow_bytes(value, order="<"):
    return struct.pack(order + "fff", value, -value, value * 2)


class TestColumnsAlone:
    def test_are_packed_in_their_order(self):
        columns = dict(zip("xyz", (floats(1, 4), floats(2, 5), floats(3, NAN)), strict=True))
        columns["intensity"] = np.array([7, 8], np.uint8)
        columns["ring"] = np.array([513, 9], np.uint16)
        columns["time"] = np.array([0.1, 0.2])
        encoded = encode_columns(columns, 2, 1)
        others = [("intensity", 12, 2, 1), ("ring", 13, 4, 1), ("time", 15, 8, 1)]
        assert as_tuples(encoded) == [*XYZ, *others]
        assert (encoded.height, encoded.width, encoded.is_bigendian) == (2, 1, False)
        assert (encoded.point_step, encoded.row_step) == (23, 23)
        first = struct.pack("<fffBHd", 1, 2, 3, 7, 513, 0.1)
        second = struct.pack("<fffBHd", 4, 5, NAN, 8, 9, 0.2)
        assert encoded.data.tobytes() == first + second
        xyz, finite = decode_xyz(encoded)
        assert xyz.tolist() == [[1.0, 2.0, 3.0]]
        assert finite.tolist() == [True, False]

    def test_sizes_that_no_message_can_state_are_refused(self):
        text = "width is -1, expected an integer from 0 to 4294967295"
        with pytest.raises(MessageError, match=f"^{text}$"):
            encode_columns({}, 1, -1)
        text = "encoded row_step is 17179869180, expected an integer from 0 to 4294967295"
        with pytest.raises(MessageError, match=f"^{text}$"):
            encode_columns({"x": floats()}, 0, 2**32 - 1)


@pytest.mark.parametrize(
    ("columns", "text"),
    [
        ({"speed": floats(1)}, "column 'speed' has shape (1,), expected (2,)"),
        ({"speed": np.ones((2, 1))}, "column 'speed' has shape (2, 1), expected (2,)"),
        ({"ok": np.ones(2, bool)}, "column 'ok' is of type bool, expected one of 1 (INT8), 2 (UIN"),
        ({"ok": np.ones(2, "i8")}, "column 'ok' is of type int64, expected one of 1 (INT8), 2 (U"),
        ({}, "no fields, expected at least one for 2 points"),
    ],
)
def test_columns_that_do_not_fit_are_refused(make_cloud, columns, text):
    cloud = make_cloud([], bytes(8), width=2, point_step=4)
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        encoded_with(cloud, columns)
    with pytest.raises(MessageError, match=f"^{re.escape(text)}"):
        encode_columns(columns, 2, 1)


class TestCloudWithColumns:
    def test_columns_follow_the_fields_of_the_cloud(self, make_cloud):
        # x y z intensity ring time, 22 bytes: the columns start at the next multiple of 4.
        fields = [*XYZ, ("intensity", 12, 7, 1), ("ring", 16, 4, 1), ("time", 18, 7, 1)]
        points = [
            struct.pack("<ffffHf", 1, 2, 3, 4, 5, 6),
            struct.pack("<ffffHf", NAN, 8, 9, 10, 11, 12),
        ]
        cloud = make_cloud(fields, b"".join(points), width=2, point_step=22)
        encoded = encoded_with(cloud, flow(0.5, NAN))
        added = [("flow_x", 24, 7, 1), ("flow_y", 28, 7, 1), ("flow_z", 32, 7, 1)]
        assert as_tuples(encoded) == [*fields, *added]
        assert (encoded.point_step, encoded.row_step) == (36, 72)
        assert encoded.data.tobytes()[:60] == b"".join(
            [points[0], bytes(2), flow_bytes(0.5), points[1], bytes(2)]
        )
        assert np.isnan(np.frombuffer(encoded.data, "<f4", 3, 60)).all()
        assert not np.shares_memory(encoded.data, np.frombuffer(cloud.data, np.uint8))

    def test_columns_of_any_byte_order_and_stride(self, make_cloud):
        cloud = make_cloud([("a", 0, 2, 1)], b"\x01\x02", width=2, point_step=1)
        columns = {"b": np.array([1, 2], ">u2"), "c": np.arange(8, dtype=np.int32)[::-4]}
        encoded = encoded_with(cloud, columns)
        assert as_tuples(encoded) == [("a", 0, 2, 1), ("b", 2, 4, 1), ("c", 4, 5, 1)]
        assert encoded.data.tobytes() == struct.pack("<BxHiBxHi", 1, 1, 7, 2, 2, 3)

    def test_fields_with_the_name_of_a_column_are_renamed(self, make_cloud):
        fields = [*XYZ, ("flow_x", 12, 7, 1), ("my_flow_x", 16, 7, 1), ("flow_x", 20, 7, 1)]
        point = struct.pack("<ffffff", 1, 2, 3, 4, 5, 6)
        cloud = make_cloud(fields, point, width=1, point_step=24)
        encoded = encoded_with(cloud, flow(0.5))
        names = ["x", "y", "z", "my_my_flow_x", "my_flow_x", "my_my_flow_x"]
        assert [name for name, *_ in as_tuples(encoded)] == [*names, "flow_x", "flow_y", "flow_z"]
        assert encoded.data.tobytes() == point + flow_bytes(0.5)
        found = clash_names(["x", "vx", "s_vx", "vy"], ["vx", "vy", "vz", "s_vy"], "s_")
        assert found == {"vx": "s_s_vx", "vy": "s_s_vy"}

    @pytest.mark.parametrize(("height", "width"), [(0, 0), (1, 0), (0, 5)])
    @pytest.mark.parametrize("fields", [XYZ, []])
    def test_empty_clouds(self, make_cloud, fields, height, width):
        cloud = make_cloud(fields, b"", height=height, width=width, point_step=0)
        encoded = encoded_with(cloud, flow())
        assert (encoded.height, encoded.width, encoded.data.size) == (height, width, 0)
        assert encoded.point_step == 12 + 4 * len(fields)

    def test_random_layouts_keep_every_byte_of_every_field(self, random_cloud, bytes_of):
        chance = random.Random(3)
        for _ in range(60):
            cloud = random_cloud(chance)
            column = np.arange(cloud.height * cloud.width, dtype=np.float32)
            encoded = encoded_with(cloud, {"speed": column})
            assert decode_points(encoded)["speed"].reshape(-1).tolist() == column.tolist()
            for old, new in zip(cloud.fields, encoded.fields[:-1], strict=True):
                assert vars(old) == asdict(new)
                for place in np.ndindex(cloud.height, cloud.width):
                    assert bytes_of(encoded, new, *place) == bytes_of(cloud, old, *place)
