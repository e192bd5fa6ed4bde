# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""New clouds from old ones; bytes compared with struct, never with a decoder."""

from __future__ import annotations

import random
import struct

import numpy as np
import pytest

from msg_utils.point_cloud2 import (
    EncodedCloud,
    clash_names,
    decode_points,
    decode_xyz,
    encode_with_columns,
)

NAN = float("nan")
XYZ = [("x", 0, 7, 1), ("y", 4, 7, 1), ("z", 8, 7, 1)]


def as_tuples(encoded):
    return [(field.name, field.offset, field.datatype, field.count) for field in encoded.fields]


def floats(*values):
    return np.array(values, np.float32)


def flow(*values):
    return {"flow_x": floats(*values), "flow_y": -floats(*values), "flow_z": floats(*values) * 2}


def flow_bytes(value, order="<"):
    return struct.pack(order + "fff", value, -value, value * 2)


def message_of(stack, encoded):
    return stack.make_cloud(
        as_tuples(encoded),
        encoded.data,
        width=encoded.width,
        height=encoded.height,
        point_step=encoded.point_step,
        row_step=encoded.row_step,
        is_bigendian=encoded.is_bigendian,
    )


def test_columns_follow_the_fields_of_the_cloud(stack):
    # x y z intensity ring time, 22 bytes: the columns start at the next multiple of 4.
    fields = [*XYZ, ("intensity", 12, 7, 1), ("ring", 16, 4, 1), ("time", 18, 7, 1)]
    points = [
        struct.pack("<ffffHf", 1, 2, 3, 4, 5, 6),
        struct.pack("<ffffHf", NAN, 8, 9, 10, 11, 12),
    ]
    cloud = stack.make_cloud(fields, b"".join(points), width=2, point_step=22)
    encoded = encode_with_columns(cloud, flow(0.5, NAN))
    assert as_tuples(encoded) == [
        *fields,
        ("flow_x", 24, 7, 1),
        ("flow_y", 28, 7, 1),
        ("flow_z", 32, 7, 1),
    ]
    assert (encoded.height, encoded.width, encoded.is_bigendian) == (1, 2, False)
    assert (encoded.point_step, encoded.row_step) == (36, 72)
    assert encoded.data.tobytes()[:36] == points[0] + bytes(2) + flow_bytes(0.5)
    assert encoded.data.tobytes()[36:60] == points[1] + bytes(2)
    assert np.isnan(np.frombuffer(encoded.data, "<f4", 3, 60)).all()
    assert bytes(cloud.data) == b"".join(points)


def test_data_is_one_piece_of_own_memory(stack):
    cloud = stack.make_cloud(XYZ, bytes(24), width=2, point_step=12)
    for encoded in (encode_with_columns(cloud, {}), encode_with_columns(cloud, flow(1, 2))):
        assert isinstance(encoded, EncodedCloud)
        assert encoded.data.dtype == np.uint8
        assert encoded.data.shape == (encoded.height * encoded.row_step,)
        assert encoded.data.flags.c_contiguous
        assert encoded.data.flags.writeable
        assert not np.shares_memory(encoded.data, np.frombuffer(cloud.data, np.uint8))


def test_a_big_endian_cloud_stays_big_endian(stack):
    data = struct.pack(">fff", 1, 2, 3)
    cloud = stack.make_cloud(XYZ, data, width=1, point_step=12, is_bigendian=True)
    encoded = encode_with_columns(cloud, {**flow(0.5), "age": np.array([258], np.uint16)})
    assert encoded.is_bigendian is True
    assert encoded.data.tobytes() == data + flow_bytes(0.5, ">") + b"\x01\x02" + bytes(2)
    xyz, _ = decode_xyz(message_of(stack, encoded))
    assert xyz.tolist() == [[1.0, 2.0, 3.0]]


def test_columns_of_any_byte_order_and_stride(make_cloud):
    cloud = make_cloud([("a", 0, 2, 1)], b"\x01\x02", width=2, point_step=1)
    columns = {"b": np.array([1, 2], ">u2"), "c": np.arange(8, dtype=np.int32)[::-4]}
    encoded = encode_with_columns(cloud, columns)
    assert as_tuples(encoded) == [("a", 0, 2, 1), ("b", 2, 4, 1), ("c", 4, 5, 1)]
    assert encoded.data.tobytes() == struct.pack("<BxHiBxHi", 1, 1, 7, 2, 2, 3)


def test_rows_with_padding_lose_only_the_padding(stack):
    rows = [[1, 2, 3], [4, 5, 6]]
    data = b"".join(struct.pack("<fff", *row) + b"\xff" * 5 for row in rows)
    cloud = stack.make_cloud([("x", 0, 7, 1)], data, width=3, height=2, point_step=4, row_step=17)
    encoded = encode_with_columns(cloud, {"age": np.arange(6, dtype=np.uint8)})
    assert (encoded.height, encoded.width) == (2, 3)
    assert (encoded.point_step, encoded.row_step) == (5, 15)
    expected = struct.pack("<fBfBfBfBfBfB", 1, 0, 2, 1, 3, 2, 4, 3, 5, 4, 6, 5)
    assert encoded.data.tobytes() == expected


def test_own_output_fed_back_keeps_its_layout(stack):
    # 32 bytes per point of which 8 are padding at the end.
    fields = [*XYZ, ("intensity", 16, 7, 1), ("ring", 20, 4, 1)]
    points = [
        struct.pack("<fffxxxxfHxx8x", 1, 2, 3, 4, 5),
        struct.pack("<fffxxxxfHxx8x", *range(5)),
    ]
    cloud = stack.make_cloud(fields, b"".join(points), width=2, point_step=32)
    first = encode_with_columns(cloud, flow(1, 2))
    assert first.point_step == 36
    second = encode_with_columns(stack.send(message_of(stack, first)), flow(3, 4))
    assert as_tuples(second) == as_tuples(first)
    assert (second.point_step, second.row_step) == (first.point_step, first.row_step)
    assert second.data.tobytes() == b"".join(
        [points[0][:24], flow_bytes(3), points[1][:24], flow_bytes(4)]
    )


def test_a_field_of_another_type_is_replaced(stack):
    fields = [("flow_x", 0, 8, 1), ("x", 8, 7, 1), ("flow_x", 12, 2, 4)]
    data = struct.pack("<df4x", 5.0, 1.0)
    cloud = stack.make_cloud(fields, data, width=1, point_step=16)
    encoded = encode_with_columns(cloud, {"flow_x": floats(2.0)})
    assert as_tuples(encoded) == [("x", 8, 7, 1), ("flow_x", 12, 7, 1)]
    assert encoded.data.tobytes()[8:] == struct.pack("<ff", 1.0, 2.0)


def test_a_replaced_field_leaves_overlapping_ones_alone(make_cloud):
    fields = [("rgb", 0, 7, 1), ("bits", 0, 6, 1)]
    cloud = make_cloud(fields, struct.pack("<I", 0xDEADBEEF), width=1, point_step=4)
    encoded = encode_with_columns(cloud, {"rgb": floats(1.0)})
    assert as_tuples(encoded) == [("bits", 0, 6, 1), ("rgb", 4, 7, 1)]
    assert encoded.data.tobytes() == struct.pack("<If", 0xDEADBEEF, 1.0)


def test_every_field_replaced(make_cloud):
    cloud = make_cloud([("speed", 4, 7, 1)], bytes(8), width=1, point_step=8)
    encoded = encode_with_columns(cloud, {"speed": floats(1.5)})
    assert as_tuples(encoded) == [("speed", 0, 7, 1)]
    assert encoded.data.tobytes() == struct.pack("<f", 1.5)


def test_odd_names_and_counts_are_kept(stack):
    fields = [("", 0, 7, 1), ("x", 4, 7, 0), ("x", 0, 7, 2), ("", 4, 2, 4)]
    data = struct.pack("<ff", 1.0, 2.0)
    cloud = stack.make_cloud(fields, data, width=1, point_step=8)
    encoded = encode_with_columns(cloud, {"speed": floats(3.0)})
    assert as_tuples(encoded) == [*fields, ("speed", 8, 7, 1)]
    assert encoded.data.tobytes() == data + struct.pack("<f", 3.0)


def test_random_layouts_keep_every_byte_of_every_field(make_cloud):
    chance = random.Random(3)
    sizes = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 8: 8}
    for _ in range(60):
        height, width = chance.randint(1, 3), chance.randint(1, 4)
        fields, point_step = [], 1
        for index in range(chance.randint(1, 5)):
            code, count, offset = chance.randint(1, 8), chance.randint(0, 3), chance.randint(0, 30)
            point_step = max(point_step, offset + sizes[code] * max(count, 1))
            fields.append((f"f{index}", offset, code, count))
        point_step += chance.choice([0, 0, 5])
        row_step = width * point_step + chance.choice([0, 3])
        data = chance.randbytes(height * row_step)
        cloud = make_cloud(
            fields,
            data,
            width=width,
            height=height,
            point_step=point_step,
            row_step=row_step,
            is_bigendian=chance.choice([False, True]),
        )
        column = np.arange(height * width, dtype=np.float32)
        encoded = encode_with_columns(cloud, {"speed": column})
        assert as_tuples(encoded)[:-1] == fields
        assert decode_points(encoded)["speed"].reshape(-1).tolist() == column.tolist()
        written = encoded.data.tobytes()
        for row in range(height):
            for point in range(width):
                old = row * row_step + point * point_step
                new = row * encoded.row_step + point * encoded.point_step
                for _, offset, code, count in fields:
                    end = offset + sizes[code] * max(count, 1)
                    assert written[new + offset : new + end] == data[old + offset : old + end]


def test_without_columns_the_padding_goes(make_cloud):
    cloud = make_cloud(XYZ, struct.pack("<ffff", 1, 2, 3, 4), width=1, point_step=16)
    encoded = encode_with_columns(cloud, {})
    assert encoded.point_step == 12
    assert encoded.data.tobytes() == struct.pack("<fff", 1, 2, 3)


@pytest.mark.parametrize(("height", "width"), [(0, 0), (1, 0), (0, 5)])
@pytest.mark.parametrize("fields", [XYZ, []])
def test_empty_clouds(stack, fields, height, width):
    cloud = stack.make_cloud(fields, b"", height=height, width=width, point_step=0)
    encoded = encode_with_columns(cloud, flow())
    assert (encoded.height, encoded.width, encoded.data.size) == (height, width, 0)
    assert encoded.point_step == 12 + 4 * len(fields)
    assert [field.name for field in encoded.fields][-3:] == ["flow_x", "flow_y", "flow_z"]
    assert decode_points(message_of(stack, encoded)).shape == (height, width)


def test_a_field_with_the_name_of_a_column_is_kept_under_another_name(stack):
    fields = [*XYZ, ("flow_x", 12, 7, 1), ("my_flow_x", 16, 7, 1), ("flow_x", 20, 7, 1)]
    point = struct.pack("<ffffff", 1, 2, 3, 4, 5, 6)
    cloud = stack.make_cloud(fields, point, width=1, point_step=24)
    encoded = encode_with_columns(cloud, flow(0.5), clash_prefix="my_")
    assert as_tuples(encoded) == [
        *XYZ,
        ("my_my_flow_x", 12, 7, 1),
        ("my_flow_x", 16, 7, 1),
        ("my_my_flow_x", 20, 7, 1),
        ("flow_x", 24, 7, 1),
        ("flow_y", 28, 7, 1),
        ("flow_z", 32, 7, 1),
    ]
    assert encoded.data.tobytes() == point + flow_bytes(0.5)


def test_other_names_are_unlike_all_names():
    names = ["x", "vx", "sensor_vx", "vy"]
    found = clash_names(names, ["vx", "vy", "vz", "sensor_vy"], "sensor_")
    assert found == {"vx": "sensor_sensor_vx", "vy": "sensor_sensor_vy"}
