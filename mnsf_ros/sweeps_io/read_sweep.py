"""Sweeps in single files, whatever their format."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Final

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.feather import read_feather
from mnsf_ros.sweeps_io.kitti_bin import read_bin
from mnsf_ros.sweeps_io.npy import read_npy
from mnsf_ros.sweeps_io.npz import read_npz
from mnsf_ros.sweeps_io.pcd import read_pcd
from mnsf_ros.sweeps_io.ply import read_ply
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile

READERS: Final[Mapping[str, Callable[[Path], SweepInFile]]] = {
    ".npz": read_npz,
    ".npy": read_npy,
    ".pcd": read_pcd,
    ".ply": read_ply,
    ".bin": read_bin,
    ".feather": read_feather,
}


def read_sweep(name: str) -> SweepInFile:
    """Reads the sweep in a file, whose ending says the format.

    Args:
        name: A path; for one of several arrays in an npz file `FILE.npz:ARRAY`.

    Raises:
        SweepFileError: If the file is missing or damaged, or of no known format.
    """
    path, read = Path(name), None
    file_name, colon, array = name.rpartition(":")
    if colon and file_name.endswith(".npz"):
        path, read = Path(file_name), partial(read_npz, name=array)
    reader = read or READERS.get(path.suffix.lower())
    if reader is None:
        raise SweepFileError(f"{path}: expected a file that ends with {', '.join(READERS)}")
    return reader(path)
