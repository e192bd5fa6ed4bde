# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Every format gives the same points; whatever else is in a file gives one kind of error."""

from __future__ import annotations

import io
import os
import random
import re
import zipfile
from pathlib import Path

import numpy as np
import pytest
import sweep_files
from sweep_files import XYZ

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.read_sweep import READERS, read_sweep

DATA = Path(os.environ.get("MNSF_DATA", Path(__file__).parents[2] / ".." / "shared" / "data"))


def npz(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


def feather(xyz=XYZ):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import feather as writer

    columns = {name: xyz[:, axis] for axis, name in enumerate("xyz")}
    table = pyarrow.table({"intensity": np.arange(len(xyz)), **columns})
    stream = io.BytesIO()
    writer.write_feather(table, stream)
    return stream.getvalue()


NAMED = np.zeros(len(XYZ), [("intensity", "u1"), ("z", "f8"), ("y", "f4"), ("x", "f4")])
for axis, name in enumerate("xyz"):
    NAMED[name] = XYZ[:, axis]

# Name of the file to its content, all of them the same points.
FILES = {
    "a.npy": lambda: npy(XYZ),
    "wide.npy": lambda: npy(np.hstack([XYZ, XYZ]).astype(np.float64)),
    "fortran.npy": lambda: npy(np.asfortranarray(XYZ)),
    "named.npy": lambda: npy(NAMED),
    "a.npz": lambda: npz(xyz=XYZ, intensity=XYZ),
    "points.npz": lambda: npz(other=XYZ[::-1], points=XYZ),
    "only.npz": lambda: npz(cloud=XYZ, labels=np.zeros(4), one=np.array(3)),
    "ascii.pcd": sweep_files.pcd_ascii,
    "binary.pcd": sweep_files.pcd_binary,
    "literal.pcd": sweep_files.pcd_compressed,
    "compressed.pcd": lambda: sweep_files.pcd_compressed(compress=sweep_files.lzf_greedy),
    "ascii.ply": sweep_files.ply_ascii,
    "crlf.ply": lambda: sweep_files.ply_ascii().replace(b"\n", b"\r\n"),
    "little.ply": lambda: sweep_files.ply_binary("<"),
    "big.ply": lambda: sweep_files.ply_binary(">"),
    "a.bin": sweep_files.kitti_bin,
    "A.BIN": sweep_files.kitti_bin,
    "a.pcd.bin": lambda: np.hstack([XYZ, np.ones((4, 2), np.float32)]).tobytes(),
    "a.feather": feather,
}


@pytest.fixture
def file(tmp_path):
    """Writes a file."""

    def write(name, content):
        path = tmp_path / name
        path.write_bytes(content)
        return path

    return write


@pytest.mark.parametrize("name", FILES)
def test_same_points_from_every_format(file, name):
    found = read_sweep(str(file(name, FILES[name]())))
    np.testing.assert_array_equal(found.xyz, XYZ)
    assert found.xyz.dtype == np.float32
    assert (found.stamp_ns, found.pose) == (0, None)
    assert found.measured.tolist() == [True, False, True, True]
    np.testing.assert_array_equal(found.sweep().xyz, XYZ[[0, 2, 3]])


NOTHING = XYZ[:0]


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("a.npy", lambda: npy(NOTHING)),
        ("a.npz", lambda: npz(xyz=NOTHING)),
        ("ascii.pcd", lambda: sweep_files.pcd_ascii(NOTHING)),
        ("binary.pcd", lambda: sweep_files.pcd_binary(NOTHING)),
        ("literal.pcd", lambda: sweep_files.pcd_compressed(NOTHING)),
        ("ascii.ply", lambda: sweep_files.ply_ascii(NOTHING)),
        ("little.ply", lambda: sweep_files.ply_binary("<", NOTHING)),
    ],
)
def test_no_points_are_a_sweep(file, name, make):
    assert read_sweep(str(file(name, make()))).xyz.shape == (0, 3)


def test_value_beyond_float32_is_no_measurement(file):
    far = np.array([[1.0, 2.0, 3.0], [1e300, 0.0, 0.0]])
    assert read_sweep(str(file("a.npy", npy(far)))).measured.tolist() == [True, False]


def test_any_bits_that_are_no_number_are_no_measurement(file):
    # A signaling NaN, which cannot be cast without a complaint.
    odd = np.array([[1.0, 2.0, 3.0]])
    odd.view(np.uint64)[0, 1] = 0x7FF0000000000001
    assert read_sweep(str(file("a.npy", npy(odd)))).measured.tolist() == [False]


def test_one_of_several_arrays(file):
    path = file("a.npz", npz(pc1=XYZ[::-1], pc2=XYZ, flow=XYZ[:, 0]))
    np.testing.assert_array_equal(read_sweep(f"{path}:pc2").xyz, XYZ)
    text = f"{path}: which array has the points? It has pc1, pc2, flow; say it as {path}:NAME"
    with pytest.raises(SweepFileError, match=f"^{re.escape(text)}$"):
        read_sweep(str(path))
    with pytest.raises(SweepFileError, match=r"has no array 'pc4'; it has pc1, pc2, flow$"):
        read_sweep(f"{path}:pc4")
    with pytest.raises(SweepFileError, match=r"array 'flow' has shape \(4,\), expected \(N, 3\)"):
        read_sweep(f"{path}:flow")


def test_what_else_is_in_an_archive_does_not_matter(file):
    path = file("a.npz", npz(meta=np.array([{"a": 1}]), names=np.array([["a", "b", "c"]]), p=XYZ))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("readme.txt", "not an array")
    np.testing.assert_array_equal(read_sweep(str(path)).xyz, XYZ)
    with pytest.raises(SweepFileError, match=r"no array 'readme'; it has meta, names, p$"):
        read_sweep(f"{path}:readme")
    with pytest.raises(SweepFileError, match=r"cut short|Object arrays|allow_pickle") as info:
        read_sweep(f"{path}:meta")
    assert "\n" not in str(info.value)


@pytest.mark.parametrize(
    ("arrays", "text"),
    [
        (
            {"stamp_ns": np.array([1, 2])},
            r"stamp_ns has shape \(2,\) of int64, expected one integer",
        ),
        ({"stamp_ns": np.float64("nan")}, r"stamp_ns has shape \(\) of float64, expected one"),
        ({"stamp_ns": np.array("12")}, r"of <U2, expected one integer"),
        ({"pose": np.full((4, 4), np.nan)}, "pose has values that are not finite"),
    ],
)
def test_stamp_or_pose_that_is_none(file, arrays, text):
    with pytest.raises(SweepFileError, match=text):
        read_sweep(str(file("a.npz", npz(xyz=XYZ, **arrays))))


def test_stamp_in_an_array_of_one(file):
    assert read_sweep(str(file("a.npz", npz(xyz=XYZ, stamp_ns=np.array([7]))))).stamp_ns == 7


def test_stamp_and_pose_beside_the_points(file):
    pose = np.diag([1.0, 2.0, 3.0, 1.0])
    found = read_sweep(
        str(file("a.npz", npz(xyz=XYZ, stamp_ns=np.int64(1_700_000_000_123), pose=pose)))
    )
    assert found.stamp_ns == 1_700_000_000_123
    np.testing.assert_array_equal(found.pose, pose)
    with pytest.raises(SweepFileError, match=r"pose has shape \(3, 3\)"):
        read_sweep(str(file("a.npz", npz(xyz=XYZ, pose=np.eye(3)))))


@pytest.mark.parametrize(
    ("name", "stamp_ns"),
    [("315966070559696000", 315966070559696000), ("1700000000123456789", 1700000000123456789)],
)
def test_name_of_an_argoverse_sweep_is_its_stamp(file, name, stamp_ns):
    assert read_sweep(str(file(f"{name}.feather", feather()))).stamp_ns == stamp_ns


def test_half_precision_feather(file):
    found = read_sweep(str(file("a.feather", feather(XYZ.astype(np.float16)))))
    np.testing.assert_array_equal(found.xyz, XYZ)


@pytest.mark.parametrize("compression", ["lz4", "zstd"])
@pytest.mark.parametrize("is_text", [False, True])
def test_feather_beyond_the_limit_is_refused_before_it_is_expanded(
    file, monkeypatch, compression, is_text
):
    pyarrow = pytest.importorskip("pyarrow")
    from pyarrow import feather as writer

    columns = {axis: np.zeros(50_000, np.float32) for axis in "xyz"}
    if is_text:
        columns["x"] = pyarrow.array(["a" * 200_000]).dictionary_encode().take([0] * 50_000)
    stream = io.BytesIO()
    writer.write_feather(pyarrow.table(columns), stream, compression=compression)
    path = file("a.feather", stream.getvalue())
    monkeypatch.setattr("mnsf_ros.decompression.MAX_BYTES", 400_000)
    monkeypatch.setattr(writer, "read_table", None)
    with pytest.raises(SweepFileError, match=r"the table has .* bytes, the limit is 400000"):
        read_sweep(str(path))


def test_feather_without_pyarrow(file, monkeypatch):
    import sys

    path = file("a.feather", b"anything")
    monkeypatch.setitem(sys.modules, "pyarrow", None)
    monkeypatch.delitem(sys.modules, "pyarrow.feather", raising=False)
    with pytest.raises(SweepFileError, match=r"not installed; install it with: python -m pip"):
        read_sweep(str(path))


@pytest.mark.parametrize("name", ["a.txt", "a", "a.npz.bak", "a.txt:pc1", "-"])
def test_format_that_is_not_known(name):
    with pytest.raises(SweepFileError, match=r": expected a file that ends with \.npz, \.npy"):
        read_sweep(name)


@pytest.mark.parametrize("suffix", READERS)
def test_file_that_is_missing_empty_or_a_folder(file, tmp_path, suffix):
    missing = tmp_path / f"missing{suffix}"
    with pytest.raises(SweepFileError, match=f"^{missing}: no such file"):
        read_sweep(str(missing))
    with pytest.raises(SweepFileError, match=r"empty\.[a-z]+: is empty$"):
        read_sweep(str(file(f"empty{suffix}", b"")))
    (tmp_path / f"folder{suffix}").mkdir()
    with pytest.raises(SweepFileError, match="cannot be read: Is a directory"):
        read_sweep(str(tmp_path / f"folder{suffix}"))


def attempt(path):
    """The sweep, or None and the error's text; any other error is a failure of the test."""
    try:
        return read_sweep(str(path)), ""
    except SweepFileError as error:
        return None, str(error)


@pytest.mark.parametrize("name", [name for name in FILES if name != "A.BIN"])
def test_file_cut_anywhere(file, name):
    content = FILES[name]()
    ends = {*range(1, len(content), 7), len(content) // 2, len(content) - 1}
    refused = 0
    for end in sorted(ends):
        path = file(name, content[:end])
        found, complaint = attempt(path)
        if found is None:
            assert complaint.startswith(f"{path}: ")
            assert "\n" not in complaint
            refused += 1
        else:
            # Cut after the points, between rows of a format without a header, or in its last
            # number, where nobody can tell.
            assert np.array_equal(found.xyz[:3], XYZ[: len(found.xyz)][:3], equal_nan=True)
    assert refused > len(ends) / 2


@pytest.mark.parametrize("name", [name for name in FILES if name != "A.BIN"])
def test_damaged_bytes_give_a_sweep_or_the_error(file, name):
    content = FILES[name]()
    rng = random.Random(name)
    for _ in range(60):
        damaged = bytearray(content)
        for _ in range(rng.choice((1, 1, 3, 20))):
            damaged[rng.randrange(len(damaged))] = rng.choice(
                (0, 10, 32, 45, 57, 255, rng.randrange(256))
            )
        path = file(name, bytes(damaged))
        found, complaint = attempt(path)
        assert complaint.startswith(f"{path}: ") if found is None else found.xyz.shape[1] == 3


def pcd_with(line, instead):
    return sweep_files.pcd_binary().replace(line.encode(), instead.encode())


def ply_with(line, instead):
    return sweep_files.ply_ascii().replace(line.encode(), instead.encode())


HUGE = "999999999999"


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.pcd", lambda: pcd_with("POINTS 4", f"POINTS {HUGE}"), "is cut short: 132 of"),
        ("a.pcd", lambda: pcd_with("POINTS 4", "POINTS -4"), "it has -4 points"),
        ("a.pcd", lambda: pcd_with("POINTS 4", "POINTS four"), "invalid literal"),
        ("a.pcd", lambda: pcd_with("POINTS 4\n", ""), None),
        ("a.pcd", lambda: pcd_with("COUNT 1 1", f"COUNT {HUGE} 1"), "is cut short: 132 of"),
        ("a.pcd", lambda: pcd_with("COUNT 1 1", "COUNT 1 0"), "index 0 is out of bounds"),
        ("a.pcd", lambda: pcd_with("SIZE 2 4", "SIZE 2 3"), "field x is 1 times F of size 3"),
        ("a.pcd", lambda: pcd_with("1 4 8\n", "1 4\n"), "zip"),
        ("a.pcd", lambda: pcd_with("TYPE U F", "TYPE U Q"), "field x is 1 times Q of size 4"),
        ("a.pcd", lambda: pcd_with("FIELDS ring x", "FIELDS ring w"), "has no field x, y, z"),
        ("a.pcd", lambda: pcd_with("DATA binary", "DATA binary_zip"), "its data is 'binary_zip'"),
        ("a.pcd", lambda: pcd_with("DATA binary", "DATUM binary"), "its header has no line DATA"),
        ("a.pcd", lambda: pcd_with("FIELDS", "FELDER"), "it has no 'FIELDS'"),
        ("a.pcd", lambda: sweep_files.pcd_ascii().replace(b"-2.25", b"two"), "could not convert"),
        ("a.pcd", lambda: sweep_files.pcd_ascii() * 2, None),
        ("a.ply", lambda: ply_with("vertex 4", f"vertex {HUGE}"), "is cut short: 5 of"),
        ("a.ply", lambda: ply_with("vertex 4", "vertex -1"), "element vertex has -1 rows"),
        ("a.ply", lambda: ply_with("element vertex", "element edge"), "it has no element 'vertex'"),
        ("a.ply", lambda: ply_with("format ascii", "format hex"), "its format is 'hex'"),
        ("a.ply", lambda: ply_with("format ascii 1.0\n", ""), "its header has no line 'format'"),
        ("a.ply", lambda: ply_with("property double x", "property quad x"), "of no known type"),
        ("a.ply", lambda: ply_with("property double x", "property double w"), "vertex has no x"),
        (
            "a.ply",
            lambda: ply_with("property int16 ring", "property list uchar int ring"),
            "element 'vertex' has lists",
        ),
        ("a.ply", lambda: b"solid" + sweep_files.ply_ascii(), "it has no header"),
        ("a.bin", lambda: sweep_files.kitti_bin() + b"x", "has 65 bytes, expected rows"),
        ("a.npy", lambda: npy(np.array([{"x": 1}])), "cut short|Object arrays|allow_pickle"),
        ("a.npy", lambda: npy(np.zeros(3)), r"the array has shape \(3,\), expected \(N, 3\)"),
        ("a.npy", lambda: npy(np.zeros((4, 2))), r"the array has shape \(4, 2\)"),
        ("a.npy", lambda: npy(np.array([["a", "b", "c"]])), "x is of <U1, expected numbers"),
        ("a.npy", lambda: npy(np.zeros((2, 3), complex)), "x is of complex128, expected numbers"),
        ("a.npy", lambda: npy(np.zeros(2, [("x", "f4"), ("y", "f4")])), "no field of name z"),
        ("a.npy", lambda: npy(XYZ).replace(b"(4, 3)", b"(9999999999, 3)"), "cut short or damaged"),
        ("a.npz", npz, "It has none"),
        ("a.npz", lambda: npy(XYZ), "single array"),
        ("a.npy", lambda: npz(xyz=XYZ), "magic"),
        ("a.feather", lambda: npy(XYZ), "cannot be read: "),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said(file, name, content, text):
    path = file(name, content())
    if text is None:
        np.testing.assert_array_equal(read_sweep(str(path)).xyz, XYZ)
        return
    with pytest.raises(SweepFileError, match=text) as info:
        read_sweep(str(path))
    assert str(info.value).startswith(f"{path}: ")


def rows_with_rings(number):
    rng = np.random.default_rng(0)
    xyz, ring = rng.uniform(-50, 50, (number, 3)), rng.integers(0, 32, (number, 1))
    return np.hstack([xyz, np.ones((number, 1)), ring]).astype("<f4")


@pytest.mark.parametrize("number", [40, 41])
def test_rows_with_rings_are_not_read_as_rows_without(file, number):
    rows = rows_with_rings(number)
    with pytest.raises(SweepFileError, match=r"and ring, .*: let its name end with \.pcd\.bin$"):
        read_sweep(str(file("a.bin", rows.tobytes())))
    for name in ("a.pcd.bin", "A.PCD.BIN"):
        np.testing.assert_array_equal(read_sweep(str(file(name, rows.tobytes()))).xyz, rows[:, :3])


@pytest.mark.parametrize("scale", [0.0, 1.0, 50.0])
def test_rows_without_rings_that_could_be_rows_of_five(file, scale):
    rows = (scale * np.random.default_rng(0).uniform(-1, 1, (40, 4))).astype("<f4")
    np.testing.assert_array_equal(read_sweep(str(file("a.bin", rows.tobytes()))).xyz, rows[:, :3])


@pytest.mark.parametrize(
    ("shape", "is_read"),
    [
        ((3, 5000), False),
        ((3, 17), False),
        ((4, 200), False),
        ((3, 4), True),
        ((3, 16), True),
        ((200, 20), True),
    ],
)
def test_points_side_by_side(file, shape, is_read):
    path = str(file("a.npy", npy(np.ones(shape))))
    if is_read:
        assert len(read_sweep(path).xyz) == shape[0]
        return
    with pytest.raises(SweepFileError, match=r"one row for each point; is it transposed\?$"):
        read_sweep(path)


def test_archive_that_claims_to_grow_beyond_bounds(file):
    import struct

    content = bytearray(npz(xyz=XYZ))
    # The size in the central directory, which is what an archive is read by.
    place = content.rfind(b"PK\x01\x02") + 24
    struct.pack_into("<I", content, place, 2**31 + 1)
    with pytest.raises(SweepFileError, match="2147483649 bytes, the limit"):
        read_sweep(str(file("a.npz", bytes(content))))


@pytest.mark.parametrize(
    ("data", "num_bytes"),
    [(b"\x00A", 10_000), (b"\x00A", 2), (b"\x05A", 6), (b"\x20\x00", 3), (b"\xe0", 9), (b"", 1)],
)
def test_damaged_compression(file, data, num_bytes):
    import struct

    header = sweep_files.PCD_HEADER.format(n=4, encoding="binary_compressed").encode()
    content = header + struct.pack("<II", len(data), num_bytes) + data
    with pytest.raises(SweepFileError, match="cannot be read"):
        read_sweep(str(file("a.pcd", content)))


def test_compression_law():
    from mnsf_ros.sweeps_io.pcd import decompress

    rng = np.random.default_rng(0)
    for content in (
        b"",
        b"a",
        b"abcabcabcabc" * 50,
        bytes(1000),
        rng.integers(0, 256, 500, dtype=np.uint8).tobytes(),
        rng.integers(0, 3, 5000, dtype=np.uint8).tobytes(),
        np.arange(3000, dtype="<u2").tobytes(),
    ):
        for compress in (sweep_files.lzf_literal, sweep_files.lzf_greedy):
            assert decompress(compress(content), len(content)) == content


@pytest.mark.skipif(not (DATA / "triplets").is_dir(), reason="no recordings beside the checkout")
def test_real_files():
    (triplet, *_) = sorted((DATA / "triplets").glob("*.npz"))
    assert read_sweep(f"{triplet}:pc2").xyz.shape == (8192, 3)
    full = read_sweep(str(DATA / "kitti_0005" / "sweep_005.npz"))
    assert len(full.xyz) > 90_000
    assert full.stamp_ns > 0
    assert full.pose.shape == (4, 4)
