# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Arrays in npy, npz and Feather files, never larger than a sweep can be.

Errors are those of NumPy and zipfile, or a ValueError: see `files.UNREADABLE`.
"""

from __future__ import annotations

import struct
import zipfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.decompression import MAX_BYTES, SizeLimitError, check_size
from mnsf_ros.sweeps_io.files import require

_VERSION_1: Final = (1, 0)
_SUFFIX: Final = ".npy"
_NPY_MAGIC: Final = b"\x93NUMPY"
# What NumPy writes. Of the others zipfile decompresses more than it was asked for.
_COMPRESSIONS: Final = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
_ARROW_HEAD: Final = b"ARROW1\0\0"
_UINT16, _INT32, _INT64 = struct.Struct("<H"), struct.Struct("<i"), struct.Struct("<q")
# Where a buffer begins in the body of a message, and how long it is.
_BUFFER: Final = struct.Struct("<qq")


class ArrayArchive:
    """The arrays of an npz file, read when asked for; all together up to the limit of a cloud."""

    def __init__(self, archive: zipfile.ZipFile) -> None:
        """Takes an open archive. What else than arrays is in it is ignored."""
        self._archive = archive
        self._left = MAX_BYTES
        entries = (entry for entry in archive.namelist() if entry.endswith(_SUFFIX))
        self.names = [entry.removesuffix(_SUFFIX) for entry in entries]

    def header(self, name: str) -> tuple[tuple[int, ...], np.dtype[Any]]:
        """Returns shape and type of an array without reading its values."""
        with self._open(name) as stream:
            return _array_header(stream)

    def array(self, name: str) -> NDArray[Any]:
        """Returns an array.

        Raises:
            ValueError: There is none of that name, or it is damaged or too large.
        """
        if name not in self.names:
            raise ValueError(f"has no array {name!r}; it has {', '.join(self.names) or 'none'}")
        num_bytes = self._archive.getinfo(f"{name}{_SUFFIX}").file_size
        self._left -= num_bytes
        if self._left < 0:
            raise SizeLimitError(
                f"array {name!r} has {num_bytes} bytes, the limit of all arrays is {MAX_BYTES}"
            )
        with self._open(name) as stream:
            return read_array(stream, num_bytes)

    def _open(self, name: str) -> IO[bytes]:
        entry = self._archive.getinfo(f"{name}{_SUFFIX}")
        if entry.compress_type not in _COMPRESSIONS:
            raise ValueError(f"array {name!r} is compressed in a way that NumPy does not write")
        # zipfile gives out no more than the size that the archive claims.
        return self._archive.open(entry)


@contextmanager
def open_archive(path: Path) -> Iterator[ArrayArchive]:
    """Opens an npz file.

    Raises:
        ValueError: It holds a single array, as npy files do.
    """
    with path.open("rb") as file:
        if file.read(len(_NPY_MAGIC)) == _NPY_MAGIC:
            raise ValueError("is a single array, expected an npz archive")
        with zipfile.ZipFile(file) as archive:
            yield ArrayArchive(archive)


def read_array(stream: IO[bytes], num_bytes: int) -> NDArray[Any]:
    """Returns the array in a stream with so many bytes, if it can really hold all values.

    A few damaged bytes of the header would otherwise ask for more memory than there is.

    Raises:
        ValueError: It cannot, or it is no array, or one of Python objects.
    """
    shape, dtype = _array_header(stream)
    expected = dtype.itemsize
    for number in shape:
        expected *= number
    if expected < 0 or expected > num_bytes:
        raise ValueError(
            f"is cut short or damaged: its array of {shape} {dtype} takes {expected} bytes, "
            f"there are {num_bytes}"
        )
    check_size(expected, "the array")
    stream.seek(0)
    array: NDArray[Any] = np.lib.format.read_array(  # type: ignore[no-untyped-call]
        stream, allow_pickle=False
    )
    return array


def _array_header(stream: IO[bytes]) -> tuple[tuple[int, ...], np.dtype[Any]]:
    version = np.lib.format.read_magic(stream)  # type: ignore[no-untyped-call]
    read_header = (
        np.lib.format.read_array_header_1_0
        if version == _VERSION_1
        else np.lib.format.read_array_header_2_0
    )
    shape, _, dtype = read_header(stream)  # type: ignore[no-untyped-call]
    return shape, dtype


def read_feather_columns(
    path: Path, names: Iterable[str], optional: Iterable[str] = ()
) -> dict[str, NDArray[Any]]:
    """Returns columns of a Feather file as (N,) arrays, the optional ones if they are there.

    Raises:
        ValueError: pyarrow is not installed, the file lacks a column, or it is too large.
    """
    feather = require("pyarrow.feather")
    check_size(path.stat().st_size, "the file")
    with path.open("rb") as file:
        # Version 1 of the format, which begins otherwise, has no compression.
        if file.read(len(_ARROW_HEAD)) == _ARROW_HEAD:
            messages = require("pyarrow.ipc").MessageReader.open_stream(file)
            check_size(sum(_expanded_size(message) for message in messages), "the table")
    # Without memory_map, since a damaged file could only be noticed later.
    table = feather.read_table(path, memory_map=False)
    missing = [name for name in names if name not in table.column_names]
    if missing:
        found = ", ".join(table.column_names)
        raise ValueError(f"has no column {', '.join(missing)}; it has {found}")
    wanted = (*names, *(name for name in optional if name in table.column_names))
    return {name: table.column(name).to_numpy() for name in wanted}


def _expanded_size(message: Any) -> int:  # noqa: ANN401
    """The bytes that the compressed buffers of an Arrow message say they expand to.

    pyarrow tells this only after it has expanded them, so the message's FlatBuffers table is read
    here: a place in it counts from the table's own, that of an entry is in a list before it.
    """
    metadata = message.metadata.to_pybytes()

    def entry(table: int, number: int) -> int:
        listed = table - _INT32.unpack_from(metadata, table)[0]
        (list_bytes,) = _UINT16.unpack_from(metadata, listed)
        place = 4 + 2 * number
        offset = _UINT16.unpack_from(metadata, listed + place)[0] if place < list_bytes else 0
        return table + int(offset) if offset else 0

    def target(place: int) -> int:
        return place + int(_INT32.unpack_from(metadata, place)[0])

    if message.type not in ("record batch", "dictionary"):
        return 0
    batch = target(entry(target(0), 2))
    if message.type == "dictionary":
        batch = target(entry(batch, 1))
    if not entry(batch, 3):  # not compressed
        return 0
    buffers = target(entry(batch, 2))
    (num_buffers,) = _INT32.unpack_from(metadata, buffers)
    places = _BUFFER.iter_unpack(metadata[buffers + 4 : buffers + 4 + _BUFFER.size * num_buffers])
    body = memoryview(message.body)
    sizes = (_INT64.unpack_from(body, offset)[0] for offset, length in places if length)
    # -1 stands before a buffer that did not shrink and is stored as it is.
    return sum(max(size, 0) for size in sizes)
