# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files that must not be read: larger than any cloud without a place on the disk, or no files."""

from __future__ import annotations

import os
import subprocess
import sys

import pytest

from mnsf_ros.decompression import MAX_BYTES

READ = """
import sys
from pathlib import Path
from mnsf_ros.datasets.source_files import read_float_rows, read_json
from mnsf_ros.errors import DatasetError, SweepFileError
from mnsf_ros.sweeps_io.read_sweep import READERS
path = Path(sys.argv[1])
readers = {**READERS, ".json": read_json, ".f32": lambda path: read_float_rows(path, 4)}
try:
    readers[path.suffix](path)
except (DatasetError, SweepFileError) as error:
    print(error)
status = Path("/proc/self/status").read_text()
print(int(status.split("VmHWM:")[1].split()[0]) // 1024)
"""


def read(path):
    """What reading says, in a process of its own, and its peak of memory in MiB."""
    command = [sys.executable, "-c", READ, path]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=100, check=True)
    *lines, peak_mib = ended.stdout.splitlines()
    return lines, int(peak_mib)


@pytest.mark.parametrize("suffix", [".bin", ".f32", ".json", ".npy", ".npz", ".pcd", ".ply"])
def test_sparse_file_is_not_read(tmp_path, suffix):
    path = tmp_path / f"large{suffix}"
    with path.open("wb") as file:
        file.truncate(2**30)
    lines, peak_mib = read(path)
    text = f"cannot be read: the file has {2**30} bytes, the limit is {MAX_BYTES} bytes"
    assert lines == [f"{path}: {text}"]
    assert peak_mib < 400


def test_sparse_feather_file_is_not_read(tmp_path):
    pytest.importorskip("pyarrow")
    test_sparse_file_is_not_read(tmp_path, ".feather")


def test_named_pipe_in_a_data_set_is_refused(tmp_path):
    pipe = tmp_path / "pipe.json"
    os.mkfifo(pipe)
    assert read(pipe)[0] == [f"{pipe}: is not a regular file"]
