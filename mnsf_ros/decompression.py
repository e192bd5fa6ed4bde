# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Decompression with limits, for everything that reads files of other people.

A few kilobytes of a damaged or hostile file can expand to all memory there is, and the size that a
file claims may be wrong. So the limit is checked while decompressing: that of one part, for memory,
and that of all parts of a file together, for time.
"""

from __future__ import annotations

import bz2
import sys
import zlib
from collections.abc import Callable, Mapping
from io import BytesIO
from typing import IO, Any, Final

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# 8 million points of 32 bytes: sixteen times what the largest lidars send at a time.
MAX_BYTES: Final = 256 * 2**20
# Whole recordings may be larger; clouds never shrink to so small a part.
_MAX_FILE_RATIO: Final = 100
# What a record counts for beside its bytes, since it takes time even if it is empty. The indexes of
# recordings are not compressed, and have 12 or 16 bytes for a message: 100 times that is more.
_RECORD_BYTES: Final = 1024
_PIECE_BYTES: Final = 2**20
# Recorders write one. Each that is empty takes time, too, and what follows it is copied.
_MAX_FRAMES: Final = 1000

# Each has `decompress(data, max_length)` and `eof`, and reads one frame.
_MAKERS: Final[Mapping[str, Callable[[], Any]]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zlib": zlib.decompressobj,
    "zstd": zstd.ZstdDecompressor,
}
COMPRESSIONS: Final = tuple(_MAKERS)


# What the libraries raise on damaged data; lz4 raises a RuntimeError, bz2 an OSError.
_DAMAGED: Final = (zstd.ZstdError, zlib.error, RuntimeError, OSError, EOFError)


class DecompressionError(ValueError):
    """Compressed data is damaged, cut short, or of an unknown kind."""


class SizeLimitError(DecompressionError):
    """Data is larger than any cloud, or claims to be."""


def check_size(num_bytes: int, what: str) -> None:
    """Checks the size of data before memory is taken for it; `what` it is goes into the error.

    Raises:
        SizeLimitError: It is above `MAX_BYTES`.
    """
    if num_bytes > MAX_BYTES:
        raise SizeLimitError(f"{what} has {num_bytes} bytes, the limit is {MAX_BYTES} bytes")


class FileBudget:
    """What all parts of a file together may expand to: `MAX_BYTES` and 100 times its size."""

    def __init__(self, file_bytes: int, what: str) -> None:
        """Starts with nothing spent; `what` it is and its size go into the error."""
        self._file_bytes = file_bytes
        self._what = what
        self._limit = MAX_BYTES + _MAX_FILE_RATIO * file_bytes
        self._num_bytes = 0
        self._num_records = 0

    @property
    def is_spent(self) -> bool:
        """Whether the file has expanded to more."""
        return self._num_bytes + _RECORD_BYTES * self._num_records > self._limit

    def spend(self, num_bytes: int) -> None:
        """Counts bytes that a part of the file has expanded to, or claims to.

        Raises:
            SizeLimitError: With these it is too much.
        """
        self._num_bytes += num_bytes
        self._check()

    def spend_record(self) -> None:
        """Counts a record within a compressed part; its bytes are counted with that.

        Raises:
            SizeLimitError: With this one it is too much.
        """
        self._num_records += 1
        self._check()

    def _check(self) -> None:
        if self.is_spent:
            counted = f", counting {_RECORD_BYTES} for each of {self._num_records} records"
            raise SizeLimitError(
                f"{self._what} of {self._file_bytes} bytes expands to more than {self._limit} bytes"
                f"{counted if self._num_records else ''}"
            )


def decompress(
    compression: str,
    data: bytes,
    claimed: int | None = None,
    *,
    is_cut: bool = False,
    budget: FileBudget | None = None,
) -> bytes:
    """Decompresses all frames of data of one of the `COMPRESSIONS`.

    The result may be smaller than the size `claimed`, not larger. If the end of the data `is_cut`
    off, its beginning is decompressed. What it expands to is taken from the `budget` of its file.

    Raises:
        SizeLimitError: The result is larger than it should be, or than `MAX_BYTES`, or the budget
            is spent.
        DecompressionError: The data is damaged or cut short, or the compression is unknown.
    """
    if compression not in _MAKERS:
        raise DecompressionError(f"compression {compression!r} is not supported")
    if claimed is not None:
        check_size(claimed, "the decompressed data")
    limit = MAX_BYTES if claimed is None else claimed
    try:
        return _expanded(compression, data, limit, is_cut, budget)
    except _DAMAGED as error:
        raise DecompressionError(f"{compression} data is damaged: {error}") from error


def _expanded(
    compression: str, data: bytes, limit: int, is_cut: bool, budget: FileBudget | None
) -> bytes:
    output, num_bytes, num_frames = BytesIO(), len(data), 0
    while data:
        num_frames += 1
        if num_frames > _MAX_FRAMES:
            raise SizeLimitError(f"{compression} data has more than {_MAX_FRAMES} frames")
        stream = _MAKERS[compression]()
        while not stream.eof:
            # Piece by piece, or the buffers of the library would double the memory.
            piece = stream.decompress(data, min(_PIECE_BYTES, limit + 1 - output.tell()))
            data = getattr(stream, "unconsumed_tail", b"")
            output.write(piece)
            if budget is not None:
                budget.spend(len(piece))
            if output.tell() > limit:
                raise SizeLimitError(
                    f"{num_bytes} bytes of {compression} data expand to more than {limit} bytes"
                )
            if not piece and not data and not stream.eof:
                if is_cut:
                    return output.getvalue()
                raise DecompressionError(f"{compression} data is cut short")
        # Other data may follow a zlib stream; of the others more frames may.
        data = b"" if compression == "zlib" else stream.unused_data
    return output.getvalue()


class LimitedFile:
    """A zstd file that ends with an error if it expands to more than a recording can be."""

    def __init__(self, file: IO[bytes]) -> None:
        """Wraps an open file of which nothing has been read."""
        self._budget = FileBudget(file.seek(0, 2), "the zstd file")
        file.seek(0)
        self._stream = zstd.open(file, "rb")

    def read(self, num_bytes: int) -> bytes:
        """Returns the next bytes, none at the end.

        Raises:
            SizeLimitError: The file expands to more than 100 times its size and 256 MiB.
            DecompressionError: It is damaged or cut short.
        """
        try:
            piece = self._stream.read(num_bytes)
        except (zstd.ZstdError, EOFError) as error:
            raise DecompressionError(f"zstd data is damaged: {error}") from error
        self._budget.spend(len(piece))
        return piece

    def __enter__(self) -> LimitedFile:
        """Does nothing: the file is open."""
        return self

    def __exit__(self, *_error: object) -> None:
        """Closes the stream, not the file."""
        self._stream.close()
