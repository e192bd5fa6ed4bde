"""NumPy files with one array (.npy)."""

from __future__ import annotations

from io import BytesIO
from pathlib import Path
from typing import IO, Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.errors import SweepFileError
from mnsf_ros.sweeps_io.sweep_in_file import SweepInFile, read_bytes, reading, xyz_of_table

_VERSION_1 = (1, 0)


def read_npy(path: Path) -> SweepInFile:
    """Reads an array (N, 3) or wider, or one with the named fields x, y and z.

    Raises:
        SweepFileError: If the file is missing, damaged, or holds something else.
    """
    content = read_bytes(path)
    with reading(path):
        array = checked_array(path, BytesIO(content), len(content))
        return SweepInFile(xyz_of_table(path, "the array", array))


def checked_array(path: Path, stream: IO[bytes], num_bytes: int) -> NDArray[Any]:
    """Reads an array of which a stream with so many bytes can really hold all values.

    A few damaged bytes of the header would else ask for more memory than there is.

    Raises:
        SweepFileError: If it cannot.
        ValueError: If it is no array, or one of Python objects.
    """
    shape, dtype = array_header(stream)
    expected = dtype.itemsize
    for number in shape:
        expected *= number
    if expected < 0 or expected > num_bytes:
        raise SweepFileError(
            f"{path}: is cut short or damaged: its array of {shape} {dtype} takes {expected} "
            f"bytes, there are {num_bytes}"
        )
    stream.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(  # type: ignore[no-untyped-call]
        stream, allow_pickle=False
    )
    return array


def array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    """Reads the shape and the type of an array; the values come next in the stream.

    Raises:
        ValueError: If it is no array.
    """
    version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
    read_header = (
        np.lib.format.read_array_header_1_0
        if version == _VERSION_1
        else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = read_header(stream)  # type: ignore[no-untyped-call]
    return shape, dtype
