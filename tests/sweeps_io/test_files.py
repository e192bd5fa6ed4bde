# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files of any origin: read or refused in one line; written as a whole or not at all."""

import os

import pytest

from mnsf_ros.errors import DatasetError
from mnsf_ros.sweeps_io.files import new_file, reading


@pytest.mark.parametrize(("name", "text"), [("none", "no such file"), ("pipe", "not a regular")])
def test_what_is_no_file_is_named_before_it_is_read(tmp_path, name, text):
    os.mkfifo(tmp_path / "pipe")
    with (
        pytest.raises(DatasetError, match=f"{name}: (is )?{text}"),
        reading(tmp_path / name),
    ):
        (tmp_path / name).read_bytes()


def written(path, write=lambda draft: draft.write_bytes(b"new"), **options):
    with new_file(path, **options) as draft:
        write(draft)


def test_existing_files_are_replaced_only_if_asked(tmp_path):
    path = tmp_path / "out.npz"
    path.write_bytes(b"precious")
    with pytest.raises(DatasetError, match=f"^{path}: exists already"):
        written(path, overwrite=False)
    assert path.read_bytes() == b"precious"
    written(path, overwrite=True)
    assert path.read_bytes() == b"new"
    assert [path.name for path in tmp_path.iterdir()] == ["out.npz"]
    (tmp_path / "folder").mkdir()
    with pytest.raises(DatasetError, match="is a folder"):
        written(tmp_path / "folder", overwrite=True)
    with pytest.raises(DatasetError, match="there is no folder"):
        written(tmp_path / "no" / "out.npz", overwrite=True)


def test_failure_half_way_leaves_nothing(tmp_path):
    def fill_disk(draft):
        draft.write_bytes(b"half")
        raise OSError(28, "No space left on device")

    with pytest.raises(DatasetError, match=r"cannot be written: No space left on device$"):
        written(tmp_path / "out.npz", fill_disk, overwrite=False)
    assert list(tmp_path.iterdir()) == []
