# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import json
import sys
import zlib

import numpy as np
import pytest
from tiny_protobuf import field, varint

from mnsf_ros.datasets.nuscenes import json_rows
from mnsf_ros.datasets.source_files import read_npz
from mnsf_ros.datasets.surface_classes import (
    ARGOVERSE1,
    ARGOVERSE2,
    KITTI,
    WAYMO,
    argoverse2_classes,
    nuscenes_class,
)
from mnsf_ros.datasets.waymo_records import matrix, parse
from mnsf_ros.decompression import MAX_BYTES, SizeLimitError
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import poses_from_quaternions
from mnsf_ros.sweeps_io.files import require


@pytest.mark.parametrize(
    ("module", "library", "missing"),
    [
        ("pyarrow.feather", "pyarrow", "pyarrow"),
        ("h5py", "h5py", "h5py"),
        ("google.protobuf.message", "protobuf", "google"),
        ("google.protobuf.message", "protobuf", "google.protobuf"),
    ],
)
def test_a_missing_library_is_named_with_the_command_that_installs_it(
    monkeypatch, module, library, missing
):
    for name in [name for name in sys.modules if f"{name}.".startswith(f"{missing}.")]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Nowhere(missing), *sys.meta_path])
    with pytest.raises(ValueError, match=f"install it with: python -m pip install {library}$"):
        require(module, library)


class Nowhere:
    """Finds no module of one library, and leaves the others to others."""

    def __init__(self, library):
        self.library = library

    def find_spec(self, name, path=None, target=None):
        if f"{name}.".startswith(f"{self.library}."):
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)


def test_a_broken_library_is_not_called_missing(tmp_path, monkeypatch):
    (tmp_path / "broken_library.py").write_text("import missing_dependency")
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(ModuleNotFoundError, match="missing_dependency"):
        require("broken_library")


@pytest.mark.parametrize("chunk", [1, 2, 7, 1 << 20])
def test_rows_of_large_json_lists(tmp_path, monkeypatch, chunk):
    monkeypatch.setattr("mnsf_ros.datasets.nuscenes._CHUNK_CHARACTERS", chunk)
    rows = [{"a": [1, {"b": "]}, {"}]}, {}, {"ü": None, "c": 1.5e-7}]
    path = tmp_path / "rows.json"
    for indent in (None, 2):
        path.write_text(json.dumps(rows, indent=indent, ensure_ascii=False), encoding="utf-8")
        assert list(json_rows(path)) == rows
    path.write_text("[]")
    assert list(json_rows(path)) == []
    path.write_text('[{"a": 1}')
    with pytest.raises(DatasetError, match="the list has no end"):
        list(json_rows(path))


def test_fields_of_a_record():
    pytest.importorskip("google.protobuf")
    numbers = np.array([1.5, -2.5])
    angles = field(2, numbers) + field(2, numbers, packed=True)
    dims = field(1, [1, 2]) + field(1, varint(3) + varint(2**30))
    data = field(1, numbers.astype("<f4"), packed=True) + varint(1 << 3 | 5)
    calibration = parse("Calibration", field(1, -3) + angles + field(4, 0.5) + field(99, "x"))
    assert (calibration.name, calibration.low, calibration.high) == (-3, 0.0, 0.5)
    assert list(calibration.angles) == [1.5, -2.5] * 2
    message = parse("Matrix", data + np.float32(0.5).tobytes() + field(2, dims))
    assert list(message.data) == [1.5, -2.5, 0.5]
    assert list(message.shape.dims) == [1, 2, 3, 2**30]
    frame = parse("Frame", field(2, 2**40) + field(6, [field(4, "räder"), field(3, 4)]))
    assert [(label.id, label.type) for label in frame.labels] == [("räder", 0), ("", 4)]
    assert (frame.micros, list(frame.pose.values), list(frame.lasers)) == (2**40, [], [])


@pytest.mark.parametrize("data", [b"\x80", b"\xff" * 11, b"\x0a\x05abc", b"\x09abc"], ids=repr)
def test_bytes_that_are_no_message(data):
    pytest.importorskip("google.protobuf")
    with pytest.raises(ValueError, match="a Frame message is damaged or cut short"):
        parse("Frame", data)


def test_poses_from_quaternions():
    half = np.sqrt(0.5)
    pose = poses_from_quaternions([half, 0, 0, half], [1, 2, 3])
    expected = [[0, -1, 0, 1], [1, 0, 0, 2], [0, 0, 1, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(pose, expected, atol=1e-12)
    assert poses_from_quaternions(np.zeros((0, 4)), np.zeros((0, 3))).shape == (0, 4, 4)
    for quaternion, position in (([0, 0, 0, 0], [0] * 3), ([1, 0, 0], [0] * 3), ([1] * 4, [0])):
        with pytest.raises(ValueError, match=r"norm|quaternion"):
            poses_from_quaternions(quaternion, position)


def test_categories_of_the_data_sets():
    assert [KITTI.get(name, 0) for name in ("Tram", "Person (sitting)", "Misc")] == [10, 7, 0]
    assert [ARGOVERSE1.get(name, 0) for name in ("BUS", "MOPED", "ANIMAL")] == [10, 8, 0]
    assert [ARGOVERSE2.get(name, 0) for name in ("SIGN", "WHEELCHAIR", "DOG")] == [11, 7, 12]
    assert [WAYMO.get(number, 0) for number in range(5)] == [0, 6, 7, 11, 8]
    names = ("vehicle.bus.rigid", "vehicle.bicycle", "human.pedestrian.adult", "animal")
    assert [nuscenes_class(name) for name in names] == [10, 8, 7, 12]
    # Background, animal, regular vehicle, the last one.
    assert argoverse2_classes(np.array([0, 1, 19, 30])).tolist() == [0, 12, 6, 8]
    for number in (-1, 31):
        with pytest.raises(ValueError, match=f"category number {number}, expected 0 to 30"):
            argoverse2_classes(np.array([3, number]))


def test_arrays_of_a_small_file_have_a_limit(tmp_path):
    path = tmp_path / "bomb.npz"
    part = np.zeros(MAX_BYTES // 16 + 1)
    np.savez_compressed(path, xyz=part, stamp_ns=part)
    assert path.stat().st_size < MAX_BYTES // 200
    with pytest.raises(DatasetError, match=rf"bomb\.npz: .*limit.*{MAX_BYTES}"):
        read_npz(path, ("xyz",))


def test_range_images_have_a_limit():
    bomb = zlib.compress(bytes(MAX_BYTES + 1))
    with pytest.raises(SizeLimitError, match=str(MAX_BYTES)):
        matrix(bomb, 4)
