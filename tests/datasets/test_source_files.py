from __future__ import annotations

import json
import sys
import zlib

import numpy as np
import pytest
from tiny_protobuf import field, varint

from mnsf_ros.datasets.nuscenes import json_rows
from mnsf_ros.datasets.protobuf_wire import WireMessage
from mnsf_ros.datasets.source_files import read_npz, require
from mnsf_ros.datasets.surface_classes import (
    argoverse1_class,
    argoverse2_class,
    argoverse2_classes,
    kitti_class,
    nuscenes_class,
    waymo_class,
)
from mnsf_ros.datasets.waymo_records import _matrix
from mnsf_ros.decompression import MAX_BYTES, SizeLimitError
from mnsf_ros.errors import DatasetError
from mnsf_ros.geometry.transforms import poses_from_quaternions


@pytest.mark.parametrize("module", ["pyarrow.feather", "h5py"])
def test_a_missing_library_is_named_with_the_command_that_installs_it(monkeypatch, module):
    library = module.partition(".")[0]
    for name in [name for name in sys.modules if name.partition(".")[0] == library]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setattr(sys, "meta_path", [Nowhere(library), *sys.meta_path])
    with pytest.raises(DatasetError, match=f"install it with: python -m pip install {library}$"):
        require(module)


class Nowhere:
    """Finds no module of one library, and leaves the others to others."""

    def __init__(self, library):
        self.library = library

    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] == self.library:
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


def test_fields_of_a_wire_message():
    numbers = np.array([1.5, -2.5])
    message = WireMessage(
        field(1, -3)
        + field(2, 300)
        + field(3, [1, 2])
        + field(3, varint(3) + varint(2**40))  # packed
        + field(4, numbers)
        + field(5, numbers, packed=True)
        + field(6, numbers.astype("<f4"), packed=True)
        + field(7, "räder")
        + field(8, [field(1, 7), field(1, 8)])
        + varint(9 << 3 | 5)
        + np.float32(0.5).tobytes()
    )
    assert (message.integer(1), message.integer(2)) == (-3, 300)
    assert message.integers(3) == [1, 2, 3, 2**40]
    assert message.doubles(4).tolist() == message.doubles(5).tolist() == [1.5, -2.5]
    assert message.double(4) == -2.5
    assert message.floats(6).tolist() == [1.5, -2.5]
    assert message.floats(9).tolist() == [0.5]
    assert message.text(7) == "räder"
    assert [one.integer(1) for one in message.messages(8)] == [7, 8]
    assert message.message(8).integer(1) == 8
    assert (message.integer(99), message.double(99), message.text(99)) == (0, 0.0, "")
    assert message.message(99).integers(1) == []


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"\x80", "an integer at byte 0 is cut short"),
        (b"\xff" * 11, "an integer at byte 0 has no end"),
        (b"\x0b", "wire type 3 at byte 1"),
        (b"\x0a\x05abc", "a field of 5 bytes at byte 2 is cut short"),
        (b"\x09abc", "a field of 8 bytes at byte 1 is cut short"),
    ],
)
def test_bytes_that_are_no_message(data, message):
    with pytest.raises(ValueError, match=message):
        WireMessage(data)


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
    assert [kitti_class(name) for name in ("Tram", "Person (sitting)", "Misc")] == [10, 7, 0]
    assert [argoverse1_class(name) for name in ("BUS", "MOPED", "ANIMAL")] == [10, 8, 0]
    assert [argoverse2_class(name) for name in ("SIGN", "WHEELCHAIR", "DOG")] == [11, 7, 12]
    assert [waymo_class(number) for number in range(5)] == [0, 6, 7, 11, 8]
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
        _matrix(bomb, 4)
