# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The view of all fields: values against struct, and the contract about memory."""

from __future__ import annotations

import array
import random
import struct

import numpy as np
import pytest

from msg_utils.point_cloud2 import decode_points

LETTERS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}
VALUES = {1: -7, 2: 200, 3: -300, 4: 60_000, 5: -70_000, 6: 4_000_000_000, 7: 1.5, 8: 0.1}


@pytest.mark.parametrize("is_bigendian", [False, True])
def test_all_datatypes_at_odd_offsets(stack, is_bigendian):
    order = ">" if is_bigendian else "<"
    fields, packed, offset = [], b"", 0
    for code, letter in LETTERS.items():
        packed += b"\xee" + struct.pack(order + letter, VALUES[code])
        fields.append((f"field_{code}", offset + 1, code, 1))
        offset += 1 + struct.calcsize(letter)
    assert len(packed) == offset == 34
    cloud = stack.make_cloud(fields, packed * 2, width=2, point_step=34, is_bigendian=is_bigendian)
    points = decode_points(stack.send(cloud))
    assert points.shape == (1, 2)
    for code, value in VALUES.items():
        assert points[f"field_{code}"].tolist() == [[value, value]]


def test_rows_with_padding(stack):
    # 2 rows of 3 points of 5 bytes (float32, uint8), each row followed by 4 bytes.
    rows = [
        b"".join(struct.pack("<fB", 10.0 * row + column, column) for column in range(3))
        + b"\xff" * 4
        for row in range(2)
    ]
    fields = [("x", 0, 7, 1), ("ring", 4, 2, 1)]
    cloud = stack.make_cloud(fields, b"".join(rows), width=3, height=2, point_step=5, row_step=19)
    points = decode_points(cloud)
    assert points["x"].tolist() == [[0.0, 1.0, 2.0], [10.0, 11.0, 12.0]]
    assert points["ring"].tolist() == [[0, 1, 2], [0, 1, 2]]


def test_several_elements_overlap_and_repeated_names(stack):
    data = struct.pack("<fff", 1.0, 2.0, 3.0) + struct.pack("<fff", 4.0, 5.0, 6.0)
    fields = [("normal", 0, 7, 3), ("y", 4, 7, 1), ("y", 8, 7, 1), ("", 0, 7, 1), ("z", 8, 7, 0)]
    points = decode_points(stack.make_cloud(fields, data, width=2, point_step=12))
    assert points["normal"].tolist() == [[[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]]
    assert points["y"].tolist() == [[2.0, 5.0]]
    assert points["y_2"].tolist() == [[3.0, 6.0]]
    assert points["unnamed_3"].tolist() == [[1.0, 4.0]]
    assert points["z"].tolist() == [[3.0, 6.0]]


def test_is_a_read_only_view_that_changes_nothing(stack):
    data = struct.pack("<ff", 1.0, 2.0)
    cloud = stack.make_cloud([("x", 0, 7, 1)], data, width=2, point_step=4)
    first, second = decode_points(cloud), decode_points(cloud)
    assert first["x"].tolist() == second["x"].tolist() == [[1.0, 2.0]]
    assert bytes(cloud.data) == data
    message_bytes = np.frombuffer(cloud.data, np.uint8)
    assert np.shares_memory(first, message_bytes)
    assert np.shares_memory(first["x"], message_bytes)
    assert not first.flags.writeable
    with pytest.raises(ValueError, match="read-only"):
        first["x"][0, 0] = 5.0


def test_the_array_of_the_message_stays_writeable(make_cloud):
    data = np.zeros(8, np.uint8)
    points = decode_points(make_cloud([("x", 0, 7, 1)], data, width=2, point_step=4))
    assert data.flags.writeable
    data[:4] = list(struct.pack("<f", 3.0))
    assert points["x"].tolist() == [[3.0, 0.0]]


@pytest.mark.parametrize(
    "hold",
    [
        bytes,
        bytearray,
        memoryview,
        lambda data: array.array("B", data),
        lambda data: np.frombuffer(data, np.uint8),
    ],
    ids=["bytes", "bytearray", "memoryview", "array", "ndarray"],
)
def test_every_kind_of_data(make_cloud, hold):
    data = hold(struct.pack("<fff", 1.0, 2.0, 3.0))
    points = decode_points(make_cloud([("x", 0, 7, 1)], data, width=3, point_step=4))
    assert points["x"].tolist() == [[1.0, 2.0, 3.0]]
    assert np.shares_memory(points, np.frombuffer(data, np.uint8))


@pytest.mark.parametrize(("height", "width"), [(0, 0), (0, 7), (1, 0), (7, 0), (2**32 - 1, 0)])
def test_empty_clouds(stack, height, width):
    fields = [("x", 0, 7, 1), ("time", 4, 8, 1)]
    for point_step in (0, 12, 32):
        cloud = stack.make_cloud(
            fields, b"", height=height, width=width, point_step=point_step, row_step=0
        )
        points = decode_points(cloud)
        assert points.shape == (height, width)
        assert points["time"].dtype == np.float64
    no_fields = stack.make_cloud([], b"", height=height, width=width, point_step=0, row_step=0)
    assert decode_points(no_fields).shape == (height, width)


def test_more_data_than_needed_and_no_padding_after_the_last_row(stack):
    one_row = struct.pack("<ff", 1.0, 2.0)
    longer = stack.make_cloud([("x", 0, 7, 1)], one_row + b"rest", width=2, point_step=4)
    assert decode_points(longer)["x"].tolist() == [[1.0, 2.0]]
    two_rows = one_row + b"\xff" * 4 + one_row
    shorter = stack.make_cloud(
        [("x", 0, 7, 1)], two_rows, width=2, height=2, point_step=4, row_step=12
    )
    assert decode_points(shorter)["x"].tolist() == [[1.0, 2.0], [1.0, 2.0]]
    wide = stack.make_cloud([("x", 0, 7, 1)], one_row, width=2, point_step=4, row_step=2**32 - 1)
    assert decode_points(wide)["x"].tolist() == [[1.0, 2.0]]


def test_random_layouts_against_struct(make_cloud):
    chance = random.Random(5)
    for _ in range(60):
        order = chance.choice("<>")
        height, width = chance.randint(1, 3), chance.randint(1, 4)
        fields, point_step = [], 1
        for index in range(chance.randint(1, 6)):
            code, count = chance.randint(1, 8), chance.randint(0, 3)
            offset = chance.randint(0, 40)
            size = struct.calcsize(LETTERS[code]) * max(count, 1)
            point_step = max(point_step, offset + size)
            fields.append((f"f{index}", offset, code, count))
        point_step += chance.choice([0, 0, 5])
        row_step = width * point_step + chance.choice([0, 3])
        data = chance.randbytes(height * row_step)
        points = decode_points(
            make_cloud(
                fields,
                data,
                width=width,
                height=height,
                point_step=point_step,
                row_step=row_step,
                is_bigendian=order == ">",
            )
        )
        for name, offset, code, count in fields:
            for row in range(height):
                for column in range(width):
                    start = row * row_step + column * point_step + offset
                    text = f"{order}{max(count, 1)}{LETTERS[code]}"
                    expected = np.array(struct.unpack_from(text, data, start))
                    found = np.atleast_1d(points[name][row, column])
                    np.testing.assert_array_equal(found, expected)
