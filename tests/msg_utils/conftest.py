# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Clouds of any values, also of those that no real message can hold."""

import struct
from types import SimpleNamespace

import pytest


@pytest.fixture
def make_cloud():
    """A cloud, its fields as tuples; rows without padding unless told."""

    def make(
        fields, data=b"", *, width=1, height=1, point_step=0, row_step=None, is_bigendian=False
    ):
        names = ("name", "offset", "datatype", "count")
        return SimpleNamespace(
            height=height,
            width=width,
            fields=[SimpleNamespace(**dict(zip(names, field, strict=True))) for field in fields],
            is_bigendian=is_bigendian,
            point_step=point_step,
            row_step=width * point_step if row_step is None else row_step,
            data=data,
        )

    return make


LETTERS = {1: "b", 2: "B", 3: "h", 4: "H", 5: "i", 6: "I", 7: "f", 8: "d"}


@pytest.fixture
def random_cloud(make_cloud):
    """A cloud of random bytes: fields of all types that overlap, padding, either byte order."""

    def make(chance):
        height, width = chance.randint(1, 3), chance.randint(1, 4)
        fields, point_step = [], 1
        for index in range(chance.randint(1, 6)):
            code, count, offset = (chance.randint(*ends) for ends in ((1, 8), (0, 3), (0, 30)))
            size = struct.calcsize(f"<{max(count, 1)}{LETTERS[code]}")
            point_step = max(point_step, offset + size)
            fields.append((f"f{index}", offset, code, count))
        point_step += chance.choice([0, 0, 5])
        row_step = width * point_step + chance.choice([0, 3])
        shape = {"width": width, "height": height, "is_bigendian": chance.random() < 0.5}
        data = chance.randbytes(height * row_step)
        return make_cloud(fields, data, point_step=point_step, row_step=row_step, **shape)

    return make


@pytest.fixture
def bytes_of():
    """Bytes and format of a field of one point in a cloud, or in an encoded one."""

    def bytes_of(cloud, field, row, column):
        text = f"{'>' if cloud.is_bigendian else '<'}{max(field.count, 1)}{LETTERS[field.datatype]}"
        start = row * cloud.row_step + column * cloud.point_step + field.offset
        return bytes(cloud.data)[start : start + struct.calcsize(text)], text

    return bytes_of
