# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Flow in files: what was written is what is read, complete or not at all."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest
from sweep_files import XYZ

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.ply import read_vertices
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


def test_npz(tmp_path):
    write_flow(tmp_path / "out.npz", RESULT)
    with np.load(tmp_path / "out.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["xyz"], XYZ)
        np.testing.assert_array_equal(arrays["flow"], FLOW)
        np.testing.assert_array_equal(arrays["kept"], KEPT)
        assert str(arrays["method"]) == "fnsf"
        assert json.loads(str(arrays["settings"])) == {"fusion.kind": "mlp", "compute.seed": 3}
    np.testing.assert_array_equal(read_sweep(str(tmp_path / "out.npz")).xyz, XYZ)


def test_npy(tmp_path):
    write_flow(tmp_path / "out.npy", RESULT)
    np.testing.assert_array_equal(np.load(tmp_path / "out.npy"), FLOW)


def test_what_moves_in_npz(tmp_path):
    write_flow(tmp_path / "out.npz", WITH_MOTION)
    with np.load(tmp_path / "out.npz", allow_pickle=False) as arrays:
        np.testing.assert_array_equal(arrays["velocity"], VELOCITY)
        for name in ("dynamic", "confidence"):
            np.testing.assert_array_equal(arrays[name], MOTION[name])
            assert arrays[name].dtype == MOTION[name].dtype
        assert not {"vx", "flow_x", "rgb"} & set(arrays)


@pytest.mark.parametrize("result", [RESULT, WITH_MOTION])
def test_ply(tmp_path, result):
    write_flow(tmp_path / "OUT.PLY", result)
    header = (tmp_path / "OUT.PLY").read_bytes().partition(b"end_header\n")[0].splitlines()
    assert header[:2] == [b"ply", b"format binary_little_endian 1.0"]
    assert b"property uchar red" in header
    columns = read_vertices(tmp_path / "OUT.PLY")
    colors = {"red": [0, 0x5C, 255, 0x5C], "green": [0, 0x61, 0, 0x61], "blue": [255, 107, 0, 107]}
    expected = {**dict(zip("xyz", XYZ.T, strict=True)), **result.columns, **colors}
    del expected["rgb"]
    assert columns.keys() == expected.keys()
    for name, values in expected.items():
        np.testing.assert_array_equal(columns[name], values)
    np.testing.assert_array_equal(read_sweep(str(tmp_path / "OUT.PLY")).xyz, XYZ)


def test_what_is_there_is_not_replaced_unless_told(tmp_path):
    path = tmp_path / "out.npy"
    path.write_bytes(b"precious")
    with pytest.raises(SweepFileError, match=f"^{path}: exists already"):
        write_flow(path, RESULT)
    assert path.read_bytes() == b"precious"
    write_flow(path, RESULT, overwrite=True)
    np.testing.assert_array_equal(np.load(path), FLOW)
    assert [path.name for path in tmp_path.iterdir()] == ["out.npy"]


class Racing:
    """A flow during whose writing somebody else writes a file of the same name."""

    def __init__(self, path):
        self.path = path

    def __array__(self, *_, **__):
        self.path.write_bytes(b"precious")
        return FLOW[:, 0]


@pytest.mark.parametrize("links", [True, False])
def test_file_that_appears_meanwhile_is_not_replaced(tmp_path, monkeypatch, links):
    def no_links(*_):
        raise OSError(1, "Operation not permitted")

    if not links:
        monkeypatch.setattr("pathlib.Path.hardlink_to", no_links)
    path = tmp_path / "out.npy"
    with pytest.raises(SweepFileError, match=f"^{path}: exists already"):
        write_flow(path, FlowToWrite(XYZ, KEPT, dict.fromkeys(COLUMNS, Racing(path))))
    assert path.read_bytes() == b"precious"
    assert [path.name for path in tmp_path.iterdir()] == ["out.npy"]


def test_file_system_without_hard_links(tmp_path, monkeypatch):
    def no_links(*_):
        raise OSError(1, "Operation not permitted")

    monkeypatch.setattr("pathlib.Path.hardlink_to", no_links)
    write_flow(tmp_path / "out.npy", RESULT)
    assert [path.name for path in tmp_path.iterdir()] == ["out.npy"]


def test_folder_is_never_replaced(tmp_path):
    (tmp_path / "out.npy").mkdir()
    with pytest.raises(SweepFileError, match="exists already"):
        write_flow(tmp_path / "out.npy", RESULT, overwrite=True)


@pytest.mark.parametrize("name", ["out.pcd", "out", "out.txt"])
def test_format_that_is_not_written(tmp_path, name):
    with pytest.raises(SweepFileError, match=r"ends with \.npz, \.npy, \.ply$"):
        write_flow(tmp_path / name, RESULT)


def test_folder_that_is_not_there(tmp_path):
    with pytest.raises(SweepFileError, match="there is no folder"):
        write_flow(tmp_path / "no" / "out.npy", RESULT)


def test_failure_half_way_leaves_nothing(tmp_path):
    class Unwritable:
        def __array__(self, *_, **__):
            raise OSError(28, "No space left on device")

    broken = FlowToWrite(XYZ, KEPT, dict.fromkeys(COLUMNS, Unwritable()))
    with pytest.raises(SweepFileError, match=r"cannot be written: No space left on device$"):
        write_flow(tmp_path / "out.npy", broken)
    assert list(tmp_path.iterdir()) == []


def test_others_may_read_the_file_as_usual(tmp_path):
    write_flow(tmp_path / "out.npy", RESULT)
    (tmp_path / "other").touch()
    modes = [(tmp_path / name).stat().st_mode for name in ("out.npy", "other")]
    assert modes[0] == modes[1]
