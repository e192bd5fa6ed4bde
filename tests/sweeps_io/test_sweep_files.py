# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps and flow in files, written byte by byte as their documents say."""

from __future__ import annotations

import io
import json
import os
import struct
import sys
from dataclasses import replace

import numpy as np
import pytest

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.files import require
from mnsf_ros.sweeps_io.sweep_files import FlowToWrite, read_points, write_flow

# Exact in float32; a row without a point; one far away.
XYZ = np.array(
    [[1.5, -2.25, 0.125], [np.nan, np.nan, np.nan], [-70.0, 3.0, 1.0], [8.0, 8.5, -1.75]],
    dtype=np.float32,
)

PCD_HEADER = (
    "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n"
    "FIELDS ring x y _ z normal\nSIZE 2 4 4 1 4 8\nTYPE U F F U F F\nCOUNT 1 1 1 3 1 2\n"
    "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA {encoding}\n"
)


def pcd_rows(xyz):
    """Packed rows with fields before, between and after."""
    dtype = np.dtype(
        [("ring", "<u2"), ("x", "<f4"), ("y", "<f4"), ("_", "u1", 3), ("z", "<f4"), ("n", "<f8", 2)]
    )
    rows = np.zeros(len(xyz), dtype)
    rows["ring"] = 9
    for axis, name in enumerate("xyz"):
        rows[name] = xyz[:, axis]
    return rows


def pcd_ascii(xyz=XYZ):
    lines = [f"9 {x!r} {y!r} 0 0 0 {z!r} 0.5 -1" for x, y, z in xyz.tolist()]
    return (PCD_HEADER.format(n=len(xyz), encoding="ascii") + "\n".join(lines) + "\n").encode()


def pcd_binary(xyz=XYZ):
    return PCD_HEADER.format(n=len(xyz), encoding="binary").encode() + pcd_rows(xyz).tobytes()


def pcd_compressed(xyz=XYZ):
    """LZF that compresses nothing: runs of up to 32 bytes as they are."""
    rows = pcd_rows(xyz)
    content = b"".join(np.ascontiguousarray(rows[name]).tobytes() for name in rows.dtype.names)
    pieces = [content[start : start + 32] for start in range(0, len(content), 32)]
    data = b"".join(bytes([len(piece) - 1]) + piece for piece in pieces)
    header = PCD_HEADER.format(n=len(xyz), encoding="binary_compressed").encode()
    return header + struct.pack("<II", len(data), len(content)) + data


def kitti_bin(xyz=XYZ):
    return np.hstack([xyz, np.full((len(xyz), 1), 0.5)]).astype("<f4").tobytes()


def npz(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def npy(array):
    stream = io.BytesIO()
    np.save(stream, array)
    return stream.getvalue()


# Name of the file to its content, all of them the same points.
FILES = {
    "a.npy": lambda: npy(XYZ),
    "wide.npy": lambda: npy(np.hstack([XYZ, XYZ]).astype(np.float64)),
    "fortran.npy": lambda: npy(np.asfortranarray(XYZ)),
    "a.npz": lambda: npz(xyz=XYZ, intensity=XYZ),
    "a.npz:pc2": lambda: npz(pc1=XYZ[::-1], pc2=XYZ),
    "ascii.pcd": pcd_ascii,
    "binary.pcd": pcd_binary,
    "compressed.pcd": pcd_compressed,
    "a.bin": kitti_bin,
    "A.BIN": kitti_bin,
    "a.pcd.bin": lambda: np.hstack([XYZ, np.ones((4, 2), np.float32)]).tobytes(),
}


@pytest.fixture
def file(tmp_path):
    """Writes a file, and returns its name."""

    def write(name, content):
        if name.endswith(".pcd"):
            pytest.importorskip("pypcd4")
        (tmp_path / name.partition(":")[0]).write_bytes(content)
        return str(tmp_path / name)

    return write


@pytest.mark.parametrize("name", FILES)
def test_same_points_from_every_format(file, name):
    found = read_points(file(name, FILES[name]()))
    np.testing.assert_array_equal(found, XYZ)
    assert found.dtype == np.float32


@pytest.mark.parametrize("name", ["a.txt", "a", "a.npz.bak", "a.txt:pc1", "-", "a.ply"])
def test_unknown_format(name):
    with pytest.raises(SweepFileError, match=r": expected a file that ends with \.npz, \.npy"):
        read_points(name)


def test_file_that_is_missing_a_folder_or_a_pipe(tmp_path):
    (tmp_path / "folder.npy").mkdir()
    os.mkfifo(tmp_path / "pipe.bin")
    for name, text in (
        ("missing.npz", ": no such file"),
        ("folder.npy", ": cannot be read: "),
        ("pipe.bin", ": is not a regular file"),
    ):
        with pytest.raises(SweepFileError, match=f"^{tmp_path / name}{text}"):
            read_points(str(tmp_path / name))


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.pcd", pcd_binary().replace(b"POINTS 4", b"POINTS 5"), "is cut short|buffer size"),
        ("a.pcd", pcd_binary()[:-33], "is cut short: it has 3 of 4 points"),
        ("a.pcd", pcd_binary().replace(b"ring x", b"ring w"), "no field of name x"),
        ("a.pcd", pcd_ascii().replace(b"-2.25", b"two"), "could not convert"),
        ("a.bin", kitti_bin() + b"x", "buffer size must be a multiple"),
        ("a.bin", kitti_bin() + bytes(4), "cannot reshape array of size 17"),
        ("a.npy", npy(np.array([{"x": 1}])), "Object arrays|allow_pickle"),
        ("a.npy", npy(np.zeros((4, 2))), r"has shape \(4, 2\), expected \(N, 3\) or wider"),
        ("a.npy", npy(np.array([["a", "b", "c"]])), "x is of <U1, expected numbers"),
        ("a.npy", npz(xyz=XYZ), "magic"),
        ("a.npz", npy(XYZ), "single array"),
        ("a.npz", npz(pc1=XYZ, pc2=XYZ), "has no array 'xyz'; it has pc1, pc2"),
    ],
)
def test_faults_are_named(file, name, content, text):
    path = file(name, content)
    with pytest.raises(SweepFileError, match=rf"^{path}: .*({text})"):
        read_points(path)


@pytest.mark.parametrize(
    ("module", "library"), [("pyarrow.feather", "pyarrow"), ("google.protobuf.message", "protobuf")]
)
def test_a_missing_library_is_named_with_its_command(monkeypatch, module, library):
    class Nowhere:
        def find_spec(self, name, *_):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

    for name in [name for name in sys.modules if f"{name}.".startswith(module.rpartition(".")[0])]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Nowhere()])
    with pytest.raises(ValueError, match=f"install it with: python -m pip install {library}$"):
        require(module, library)


def test_a_broken_library_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "broken_library.py").write_text("import missing_dependency")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="missing_dependency"):
        require("broken_library")


FLOW = np.array([[0.5, 0, -0.25], [np.nan] * 3, [1, 2, 3], [0, 0, 0]], dtype=np.float32)
KEPT = np.array([True, False, False, True])
COLUMNS = dict(zip(("flow_x", "flow_y", "flow_z"), FLOW.T, strict=True))
# Grey where nothing moves.
COLUMNS["rgb"] = np.uint32([0x0000FF, 0x5C616B, 0xFF0000, 0x5C616B]).view(np.float32)
RESULT = FlowToWrite(XYZ, KEPT, COLUMNS, "fnsf", {"fusion.kind": "mlp", "compute.seed": 3})
VELOCITY = np.float32([[0, -9, 0], [np.nan] * 3, [8, 0, 0], [0, 0, 0]])
MOTION = {
    **dict(zip(("vx", "vy", "vz"), VELOCITY.T, strict=True)),
    "dynamic": np.uint8([1, 0, 1, 0]),
    "confidence": np.float32([0.5, np.nan, 0.25, 1]),
}
WITH_MOTION = replace(RESULT, columns=COLUMNS | MOTION)


@pytest.mark.parametrize("result", [RESULT, WITH_MOTION])
def test_npz(tmp_path, result):
    write_flow(tmp_path / "out.npz", result)
    with np.load(tmp_path / "out.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["xyz"], XYZ)
        np.testing.assert_array_equal(arrays["flow"], FLOW)
        np.testing.assert_array_equal(arrays["kept"], KEPT)
        assert str(arrays["method"]) == "fnsf"
        assert json.loads(str(arrays["settings"])) == {"fusion.kind": "mlp", "compute.seed": 3}
        assert not {"vx", "flow_x", "rgb"} & set(arrays)
        assert ("velocity" in arrays) == (result is WITH_MOTION)
        if result is WITH_MOTION:
            np.testing.assert_array_equal(arrays["velocity"], VELOCITY)
            np.testing.assert_array_equal(arrays["confidence"], MOTION["confidence"])
            assert arrays["dynamic"].dtype == np.uint8
    np.testing.assert_array_equal(read_points(str(tmp_path / "out.npz")), XYZ)


@pytest.mark.parametrize("result", [RESULT, WITH_MOTION])
def test_ply(tmp_path, result):
    write_flow(tmp_path / "OUT.PLY", result)
    header, _, body = (tmp_path / "OUT.PLY").read_bytes().partition(b"end_header\n")
    lines = [line.split() for line in header.decode().splitlines()]
    assert lines[:2] == [["ply"], ["format", "binary_little_endian", "1.0"]]
    assert ["element", "vertex", "4"] in lines
    types = {"float": "<f4", "uchar": "u1"}
    fields = [(line[2], types[line[1]]) for line in lines if line[0] == "property"]
    rows = np.frombuffer(body, np.dtype(fields))
    colors = {"red": [0, 0x5C, 255, 0x5C], "green": [0, 0x61, 0, 0x61], "blue": [255, 107, 0, 107]}
    expected = {**dict(zip("xyz", XYZ.T, strict=True)), **result.columns, **colors}
    del expected["rgb"]
    assert set(rows.dtype.names) == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(rows[name], values)


def test_existing_files_are_replaced_only_if_asked(tmp_path):
    path = tmp_path / "out.npz"
    path.write_bytes(b"precious")
    with pytest.raises(SweepFileError, match=f"^{path}: exists already"):
        write_flow(path, RESULT)
    assert path.read_bytes() == b"precious"
    write_flow(path, RESULT, overwrite=True)
    np.testing.assert_array_equal(read_points(f"{path}:flow"), FLOW)
    assert [path.name for path in tmp_path.iterdir()] == ["out.npz"]
    (tmp_path / "folder.npz").mkdir()
    with pytest.raises(SweepFileError, match="exists already"):
        write_flow(tmp_path / "folder.npz", RESULT, overwrite=True)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("out.pcd", r"ends with \.npz, \.ply$"),
        ("out", "ends with"),
        ("no/out.npz", "there is no folder"),
    ],
)
def test_unusable_names(tmp_path, name, text):
    with pytest.raises(SweepFileError, match=text):
        write_flow(tmp_path / name, RESULT)


def test_failure_half_way_leaves_nothing(tmp_path):
    class Unwritable:
        def __array__(self, *_, **__):
            raise OSError(28, "No space left on device")

    broken = FlowToWrite(XYZ, KEPT, dict.fromkeys(COLUMNS, Unwritable()))
    with pytest.raises(SweepFileError, match=r"cannot be written: No space left on device$"):
        write_flow(tmp_path / "out.npz", broken)
    assert list(tmp_path.iterdir()) == []
