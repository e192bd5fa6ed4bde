# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Decompression that ends at a size: libraries follow the size that the data itself claims."""

import sys
import zlib
from pathlib import Path
from typing import Any, Final, cast

# The largest lidars send 10 MB a sweep; what is larger is damaged.
MAX_BYTES: Final = 2**29
# Measured: an organized cloud with returns in 5 % of its rows shrinks to a 18th, in 1 % to an 82nd,
# zeros to a thirty-thousandth.
_MAX_RATIO: Final = 100
_PIECE_BYTES: Final = 2**20
# That zlib tells its own format and that of gzip apart.
_EITHER_HEADER: Final = zlib.MAX_WBITS + 32


def expanded(data: bytes, kind: str, max_bytes: int = MAX_BYTES) -> bytes:
    """Returns a compressed frame of the kind `zstd`, `lz4` or `zlib` (or gzip), decompressed.

    Raises:
        EOFError: It is cut short, expands to more than `max_bytes`, or more follows.
        Exception: One of the library: it is damaged.
    """
    decompressor = _decompressor(kind)
    content = cast("bytes", decompressor.decompress(data, max_bytes + 1))
    if len(content) > max_bytes:
        raise EOFError(f"it expands to more than {max_bytes} bytes")
    if not decompressor.eof or decompressor.unused_data:
        raise EOFError("its compressed data is cut short, or more follows")
    return content


def expand_file(compressed: Path, plain: Path) -> None:
    """Decompresses a zstd file to another.

    Raises:
        EOFError: It is cut short, or expands to more than recordings do.
        Exception: One of the library: it is damaged.
    """
    max_bytes = max(MAX_BYTES, _MAX_RATIO * compressed.stat().st_size)
    with zstd_library().open(compressed, "rb") as content, plain.open("wb") as file:
        while piece := content.read(_PIECE_BYTES):
            if file.tell() + len(piece) > max_bytes:
                raise EOFError(f"it expands to more than {max_bytes} bytes")
            file.write(piece)


def _decompressor(kind: str) -> Any:  # noqa: ANN401 - all have the interface of bz2
    if kind == "zstd":
        return zstd_library().ZstdDecompressor()
    if kind == "zlib":
        return zlib.decompressobj(_EITHER_HEADER)
    from lz4.frame import LZ4FrameDecompressor

    return LZ4FrameDecompressor()


def zstd_library() -> Any:  # noqa: ANN401 - a module
    """Returns the module `zstd` of this Python, or its backport."""
    if sys.version_info >= (3, 14):
        from compression import zstd
    else:
        from backports import zstd
    return zstd
