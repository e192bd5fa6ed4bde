# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Every format gives the same points; anything else in a file gives one kind of error."""

from __future__ import annotations

import os
import re
import sys
import zipfile

import numpy as np
import pytest
from sweep_files import (
    XYZ,
    feather,
    kitti_bin,
    npy,
    npz,
    pcd_ascii,
    pcd_binary,
    pcd_compressed,
)

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.files import require
from mnsf_ros.sweeps_io.read_sweep import ENDINGS, read_sweep

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
    "ascii.pcd": pcd_ascii,
    "binary.pcd": pcd_binary,
    "compressed.pcd": pcd_compressed,
    "a.bin": kitti_bin,
    "A.BIN": kitti_bin,
    "a.pcd.bin": lambda: np.hstack([XYZ, np.ones((4, 2), np.float32)]).tobytes(),
    "a.feather": feather,
    "half.feather": lambda: feather(XYZ.astype(np.float16)),
}


@pytest.fixture
def file(tmp_path):
    """Writes a file."""

    def write(name, content):
        if name.endswith(".pcd"):
            pytest.importorskip("pypcd4")
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


def test_values_that_are_no_float32_are_no_points(file):
    assert read_sweep(str(file("none.npy", npy(XYZ[:0])))).xyz.shape == (0, 3)
    odd = np.array([[1.0, 2.0, 3.0], [1e300, 0.0, 0.0], [1.0, 2.0, 3.0]])
    odd.view(np.uint64)[2, 1] = 0x7FF0000000000001  # a signaling NaN
    assert read_sweep(str(file("a.npy", npy(odd)))).measured.tolist() == [True, False, False]


def test_one_of_several_arrays(file):
    path = file("a.npz", npz(pc1=XYZ[::-1], pc2=XYZ, flow=XYZ[:, 0]))
    np.testing.assert_array_equal(read_sweep(f"{path}:pc2").xyz, XYZ)
    text = f"{path}: which array has the points? It has pc1, pc2, flow; name one as {path}:NAME"
    with pytest.raises(SweepFileError, match=f"^{re.escape(text)}$"):
        read_sweep(str(path))
    with pytest.raises(SweepFileError, match=r"has no array 'pc4'; it has pc1, pc2, flow$"):
        read_sweep(f"{path}:pc4")
    with pytest.raises(SweepFileError, match=r"array 'flow' has shape \(4,\), expected \(N, 3\)"):
        read_sweep(f"{path}:flow")


def test_other_content_of_an_archive_does_not_matter(file):
    path = file("a.npz", npz(meta=np.array([{"a": 1}]), names=np.array([["a", "b", "c"]]), p=XYZ))
    with zipfile.ZipFile(path, "a") as archive:
        archive.writestr("readme.txt", "not an array")
    np.testing.assert_array_equal(read_sweep(str(path)).xyz, XYZ)
    with pytest.raises(SweepFileError, match=r"Object arrays|allow_pickle"):
        read_sweep(f"{path}:meta")


def test_stamp_and_pose_beside_the_points(file):
    pose = np.diag([1.0, 2.0, 3.0, 1.0])
    stamp = np.array([1_700_000_000_123])
    found = read_sweep(str(file("a.npz", npz(xyz=XYZ, stamp_ns=stamp, pose=pose))))
    assert found.stamp_ns == 1_700_000_000_123
    np.testing.assert_array_equal(found.pose, pose)
    name = "315966070559696000.feather"
    assert read_sweep(str(file(name, feather()))).stamp_ns == 315966070559696000


@pytest.mark.parametrize("name", ["a.txt", "a", "a.npz.bak", "a.txt:pc1", "-", "a.ply"])
def test_unknown_format(name):
    with pytest.raises(SweepFileError, match=r": expected a file that ends with \.npz, \.npy"):
        read_sweep(name)


@pytest.mark.parametrize("suffix", ENDINGS)
def test_file_that_is_missing_empty_a_folder_or_a_pipe(file, tmp_path, suffix):
    if suffix in (".pcd", ".feather"):
        pytest.importorskip("pypcd4" if suffix == ".pcd" else "pyarrow")
    for name, text in (
        ("missing", ": no such file"),
        ("empty", ": is empty"),
        ("folder", ": cannot be read: "),
        ("pipe", ": is not a regular file"),
    ):
        path = tmp_path / f"{name}{suffix}"
        make = {"empty": path.touch, "folder": path.mkdir, "pipe": lambda at=path: os.mkfifo(at)}
        make.get(name, lambda: None)()
        with pytest.raises(SweepFileError, match=f"^{path}{text}"):
            read_sweep(str(path))


@pytest.mark.parametrize("name", [name for name in FILES if name != "A.BIN"])
def test_cut_files_give_whole_rows_or_the_error(file, name):
    content = FILES[name]()
    refused = 0
    ends = range(1, len(content), 11)
    for end in ends:
        path = file(name, content[:end])
        try:
            found = read_sweep(str(path)).xyz
        except SweepFileError as error:
            assert "\n" not in str(error)  # noqa: PT017 - files cut between rows are read
            refused += 1
        else:
            # Cut between rows without a header, or in the last number of a text.
            assert np.array_equal(found[:3], XYZ[: len(found)][:3], True)
    assert refused > len(ends) / 2


@pytest.mark.parametrize(
    ("name", "content", "text"),
    [
        ("a.pcd", pcd_binary().replace(b"POINTS 4", b"POINTS 5"), "is cut short|buffer size"),
        ("a.pcd", pcd_binary()[:-33], "is cut short: it has 3 of 4 points"),
        ("a.pcd", pcd_binary().replace(b"TYPE U F", b"TYPE U Q"), "type"),
        ("a.pcd", pcd_binary().replace(b"ring x", b"ring w"), "has no field x; it has ring, w"),
        ("a.pcd", pcd_binary().replace(b"FIELDS", b"FELDER"), "fields"),
        ("a.pcd", pcd_ascii().replace(b"-2.25", b"two"), "could not convert"),
        ("a.bin", kitti_bin() + b"x", "has 65 bytes, expected rows"),
        ("a.npy", npy(np.array([{"x": 1}])), "Object arrays|allow_pickle"),
        ("a.npy", npy(np.zeros(3)), r"the array has shape \(3,\), expected \(N, 3\)"),
        ("a.npy", npy(np.zeros((4, 2))), r"the array has shape \(4, 2\)"),
        ("a.npy", npy(np.array([["a", "b", "c"]])), "x is of <U1, expected numbers"),
        ("a.npy", npy(np.zeros((2, 3), complex)), "x is of complex128, expected numbers"),
        ("a.npy", npy(np.zeros(2, [("x", "f4"), ("y", "f4")])), "no field of name z"),
        ("a.npz", npz(), "It has none"),
        ("a.npz", npz(xyz=XYZ, stamp_ns=np.array([1, 2])), r"stamp_ns has shape \(2,\) of int64"),
        ("a.npz", npz(xyz=XYZ, stamp_ns=np.float64("nan")), r"stamp_ns has shape \(\) of float64"),
        ("a.npz", npz(xyz=XYZ, pose=np.full((4, 4), np.nan)), "pose has values that are not fin"),
        ("a.npz", npz(xyz=XYZ, pose=np.eye(3)), r"pose has shape \(3, 3\)"),
        ("a.npz", npy(XYZ), "single array"),
        ("a.npy", npz(xyz=XYZ), "magic"),
        ("a.feather", npy(XYZ), "cannot be read: "),
    ],
)
def test_faults_are_named(file, name, content, text):
    path = file(name, content)
    with pytest.raises(SweepFileError, match=rf"^{path}: .*({text})"):
        read_sweep(str(path))


def test_rows_with_rings_are_not_read_as_rows_without(file):
    rng = np.random.default_rng(0)
    xyz, ring = rng.uniform(-50, 50, (40, 3)), rng.integers(0, 32, (40, 1))
    rows = np.hstack([xyz, np.ones((40, 1)), ring]).astype("<f4")
    with pytest.raises(SweepFileError, match=r"and ring, .*: let its name end with \.pcd\.bin$"):
        read_sweep(str(file("a.bin", rows.tobytes())))
    found = read_sweep(str(file("A.PCD.BIN", rows.tobytes())))
    np.testing.assert_array_equal(found.xyz, rows[:, :3])
    # 40 rows of four could be 32 rows of five.
    plain = rows[:, :4]
    found = read_sweep(str(file("a.bin", plain.tobytes())))
    np.testing.assert_array_equal(found.xyz, plain[:, :3])


@pytest.mark.parametrize("shape", [(3, 5000), (3, 17)])
def test_transposed_arrays_are_refused(file, shape):
    with pytest.raises(SweepFileError, match=r"one row for each point; is it transposed\?$"):
        read_sweep(str(file("a.npy", npy(np.ones(shape)))))
    for usual in ((3, 4), (3, 16), (200, 20)):
        assert len(read_sweep(str(file("a.npy", npy(np.ones(usual))))).xyz) == usual[0]


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
