# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Compressed parts of recordings: chunks, messages and whole files."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any, Final

import lz4.frame

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# The largest lidars send 10 MB a sweep; what is larger is damaged.
MAX_BYTES: Final = 2**29
# How each zstd frame begins. A ROS 2 message begins with a zero byte, so the bytes tell which is
# which, also in a file that has lost the metadata.yaml which says so.
_ZSTD_MAGIC: Final = b"\x28\xb5\x2f\xfd"
_DECOMPRESSORS: Final[dict[str, Callable[[], Any]]] = {
    "lz4": lz4.frame.LZ4FrameDecompressor,
    "zstd": zstd.ZstdDecompressor,
}


def expanded(compression: str, data: bytes, max_bytes: int = MAX_BYTES) -> bytes:
    """Returns decompressed data, of the compression `lz4` or `zstd`.

    Raises:
        ValueError: It is damaged, has more bytes, or is of another compression.
    """
    if compression not in _DECOMPRESSORS:
        raise ValueError(f"compression {compression!r} is not supported")
    stream = _DECOMPRESSORS[compression]()
    try:
        content: bytes = stream.decompress(data, max_bytes + 1)
    except (zstd.ZstdError, RuntimeError) as error:
        raise ValueError(f"{compression} data is damaged: {error}") from error
    if len(content) > max_bytes:
        raise ValueError(f"{compression} data expands to more than {max_bytes} bytes")
    if not stream.eof:
        raise ValueError(f"{compression} data is cut short")
    return content


def expanded_message(raw: bytes) -> bytes:
    """Returns a ROS 2 message, decompressed if it was compressed by itself.

    Raises:
        ValueError: It is damaged or too large.
    """
    return expanded("zstd", raw) if raw.startswith(_ZSTD_MAGIC) else raw


def expand_file(file: Path, target: Path) -> None:
    """Decompresses a file that is compressed as a whole (zstd).

    Raises:
        ValueError: It is damaged.
        OSError: It cannot be read, or there is no space left for its content.
    """
    try:
        with zstd.open(file, "rb") as content, target.open("wb") as plain:
            shutil.copyfileobj(content, plain)
    except (zstd.ZstdError, EOFError) as error:
        raise ValueError(f"zstd data is damaged: {error}") from error
