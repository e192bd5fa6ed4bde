# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Small files that expand beyond the memory limit of a command: one line, exit status 3."""

import subprocess
import sys
import zipfile

import numpy as np
import pytest

NUM_POINTS = 100_000_000
PIECE = np.zeros(NUM_POINTS // 20, np.float32)


def write_npz(path):
    header = {"descr": "<f4", "fortran_order": False, "shape": (NUM_POINTS, 3)}
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED, compresslevel=1) as archive:
        with archive.open("stamp_ns.npy", "w") as file:
            np.lib.format.write_array(file, np.array(5))
        with archive.open("xyz.npy", "w", force_zip64=True) as file:
            np.lib.format.write_array_header_1_0(file, header)
            for _ in range(60):
                file.write(PIECE.tobytes())


def write_h5(path):
    h5py = pytest.importorskip("h5py")
    with h5py.File(path, "w") as file:
        group = file.create_group("1600000000000000000")
        # Chunks that were never written take no room in the file.
        group.create_dataset("lidar", (NUM_POINTS, 3), np.float32, chunks=(1000, 3))
        group["pose"] = np.eye(4)


@pytest.mark.slow
@pytest.mark.parametrize("write", [write_npz, write_h5])
def test_a_command_ends_in_one_line_with_the_file_and_the_limit(tmp_path, write):
    path = tmp_path / "in" / f"a.{write.__name__.removeprefix('write_')}"
    path.parent.mkdir()
    write(path)
    assert path.stat().st_size < 20_000_000
    source = ("opensceneflow", path) if path.suffix == ".h5" else ("sweeps", path.parent)
    command = ["convert", *source, tmp_path / "out"]
    ended = subprocess.run(
        [sys.executable, "-m", "mnsf_ros.cli", *map(str, command), "--max-memory", "0.8"],
        capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert ended.returncode == 3
    *_, last = ended.stderr.splitlines()
    assert last.startswith(f"mnsf: {path}: cannot be read: ")
    assert last.endswith("memory is limited to 0.8 GB (--max-memory)")
    assert "Traceback" not in ended.stderr
