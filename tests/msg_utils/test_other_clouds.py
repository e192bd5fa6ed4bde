# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Compressed clouds, those of Livox, and what cannot be read of them."""

import gzip
import sys
import zlib
from types import SimpleNamespace

import numpy as np
import pytest

from msg_utils import other_clouds
from msg_utils.errors import MessageError
from msg_utils.expansion import zstd_library
from msg_utils.other_clouds import UnsupportedCloudError, as_cloud
from msg_utils.point_cloud2 import decode_points, encode_columns
from msg_utils.point_times import decode_times

NUM = 4000
RANDOM = np.random.default_rng(0)
COLUMNS = {
    **{axis: RANDOM.uniform(-50, 50, NUM).astype(np.float32) for axis in "xyz"},
    "ring": np.arange(NUM, dtype=np.uint16) % 16,
    "time": np.linspace(0, 0.0999, NUM).astype(np.float32),
}
CLOUD = encode_columns(COLUMNS, 1, NUM)
DATA = bytes(CLOUD.data)


def compressed(form, data, **changes):
    values = {
        name: getattr(CLOUD, name)
        for name in ("height", "width", "fields", "is_bigendian", "point_step", "row_step")
    }
    header = SimpleNamespace(frame_id="lidar")
    values |= {"header": header, "format": form, "compressed_data": data, "is_dense": True}
    return SimpleNamespace(**values | changes)


@pytest.mark.parametrize(
    ("form", "compress"),
    [
        ("zstd", lambda data: zstd_library().compress(data)),
        ("zlib", zlib.compress),
        ("zlib", gzip.compress),  # as zlib_point_cloud_transport does
    ],
)
def test_lossless_formats_give_every_bit(form, compress):
    cloud = as_cloud(compressed(form, compress(DATA)))
    assert bytes(cloud.data) == DATA
    assert (cloud.header.frame_id, cloud.is_dense) == ("lidar", True)
    np.testing.assert_array_equal(decode_points(cloud), decode_points(CLOUD))


def cloudini(version=5, resolution=0.001):
    pureini = pytest.importorskip("pureini")
    fields = [
        pureini.PointField(
            name=field.name,
            offset=field.offset,
            type=pureini.FieldType[field.scalar.name.upper()],
            resolution=resolution if field.scalar.kind == "f" else None,
        )
        for field in CLOUD.fields
    ]
    info = pureini.EncodingInfo(fields, NUM, 1, CLOUD.point_step, version=version)
    info.encoding_opt = pureini.EncodingOptions.LOSSY
    info.compression_opt = pureini.CompressionOption.ZSTD
    return pureini.PointcloudEncoder(info).encode(DATA)


@pytest.mark.parametrize("version", [2, 3, 5])
def test_cloudini_is_told_by_its_data_and_keeps_order_and_number(version):
    points = decode_points(as_cloud(compressed("", cloudini(version)))).ravel()
    np.testing.assert_array_equal(points["ring"], COLUMNS["ring"])
    for name in ("x", "y", "z", "time"):
        np.testing.assert_allclose(points[name], COLUMNS[name], atol=0.00051)


def test_times_that_cloudini_has_rounded_are_told_and_not_used_if_only_a_few_are_left():
    wanted, rule = np.ones(NUM, bool), SimpleNamespace(field="auto", unit="auto", stamp="auto")

    def times(resolution):
        cloud = as_cloud(compressed("cloudini", cloudini(resolution=resolution)))
        return decode_times(cloud, wanted, 10**18, rule, 0.1)

    assert "in steps" not in times(0.001).source
    assert "in steps of 10 ms" in times(0.01).source
    rounded = times(0.025)
    assert rounded.times_s is None
    assert "'time': only 5 values: rounded, as by lossy compression" in rounded.fault


def test_livox_points_are_those_of_the_message_with_their_times():
    points = [
        SimpleNamespace(offset_time=5_000 * i, x=1.0 * i, y=-2.0, z=0.5, reflectivity=7 + i)
        for i in range(3)
    ]
    for point in points:
        point.tag, point.line = 16, 3
    header = SimpleNamespace(frame_id="livox_frame")
    message = SimpleNamespace(header=header, timebase=10**18, points=points)
    found = decode_points(as_cloud(message))[0]
    assert found.dtype.names == ("offset_time", "x", "y", "z", "intensity", "tag", "line")
    assert found["offset_time"].tolist() == [0, 5_000, 10_000]
    assert found["x"].tolist() == [0.0, 1.0, 2.0]
    assert found["intensity"].tolist() == [7, 8, 9]
    message.points = []
    assert decode_points(as_cloud(message)).shape == (1, 0)


def test_a_cloud_stays_as_it_is():
    assert as_cloud(CLOUD) is CLOUD


def test_empty_clouds_need_no_data():
    for form in ("zstd", "cloudini"):
        cloud = as_cloud(compressed(form, b"", width=0, row_step=0))
        assert decode_points(cloud).shape == (1, 0)


@pytest.mark.parametrize(
    ("form", "words"),
    [
        ("draco", "draco lose equal points and their order: take the topic of the transport zstd"),
        ("blosc2", "the format 'blosc2', expected zstd, zlib or cloudini"),
        ("", "the format '', expected"),
        ("z" * 10**6, "the format 'zzz"),
    ],
)
def test_formats_that_cannot_be_read_are_named(form, words):
    with pytest.raises(UnsupportedCloudError) as caught:
        as_cloud(compressed(form, b"DRACO"))
    assert words in str(caught.value)
    assert len(str(caught.value)) < 300


def test_cloudini_without_its_library_names_it(monkeypatch):
    monkeypatch.setitem(sys.modules, "pureini", None)
    with pytest.raises(UnsupportedCloudError, match="pip install pureini"):
        as_cloud(compressed("cloudini", b""))


@pytest.mark.parametrize(
    ("message", "words"),
    [
        (lambda: compressed("zstd", zstd_library().compress(DATA)[:-5]), "cut short"),
        (lambda: compressed("zstd", DATA), "damaged"),
        (lambda: compressed("zlib", zlib.compress(DATA + b"more")), f"more than {len(DATA)} bytes"),
        (lambda: compressed("zstd", zstd_library().compress(bytes(10**9))), "expands to more than"),
        (lambda: compressed("zstd", zstd_library().compress(DATA), width=2**32 - 1), "at least"),
        (lambda: compressed("cloudini", cloudini()[:-5]), "damaged"),
        (lambda: compressed("cloudini", cloudini()[:30]), "damaged"),
        (lambda: compressed("cloudini", cloudini(), width=NUM + 1), "point_step"),
    ],
)
def test_damaged_data_is_refused_and_takes_no_more_memory_than_its_points(message, words):
    with pytest.raises(MessageError, match=words):
        decode_points(as_cloud(message()))


def test_what_cloudini_claims_is_checked_before_memory_is_taken(monkeypatch):
    data = cloudini()
    monkeypatch.setattr(other_clouds, "MAX_BYTES", len(DATA) - 1)
    with pytest.raises(MessageError, match="at most"):
        as_cloud(compressed("cloudini", data))
