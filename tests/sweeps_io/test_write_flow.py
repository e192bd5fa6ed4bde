# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Flow in files: what was written is what is read, complete or not at all."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from sweep_files import XYZ

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.read_sweep import read_sweep
from mnsf_ros.sweeps_io.write_flow import FlowToWrite, write_flow

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
    np.testing.assert_array_equal(read_sweep(str(tmp_path / "out.npz")).xyz, XYZ)


def test_npy(tmp_path):
    write_flow(tmp_path / "out.npy", RESULT)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), FLOW)


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
    path = tmp_path / "out.npy"
    path.write_bytes(b"precious")
    with pytest.raises(SweepFileError, match=f"^{path}: exists already"):
        write_flow(path, RESULT)
    assert path.read_bytes() == b"precious"
    write_flow(path, RESULT, overwrite=True)
    np.testing.assert_array_equal(np.load(path), FLOW)
    assert [path.name for path in tmp_path.iterdir()] == ["out.npy"]
    (tmp_path / "folder.npy").mkdir()
    with pytest.raises(SweepFileError, match="exists already"):
        write_flow(tmp_path / "folder.npy", RESULT, overwrite=True)


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("out.pcd", r"ends with \.npz, \.npy, \.ply$"),
        ("out", "ends with"),
        ("no/out.npy", "there is no folder"),
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
        write_flow(tmp_path / "out.npy", broken)
    assert list(tmp_path.iterdir()) == []
