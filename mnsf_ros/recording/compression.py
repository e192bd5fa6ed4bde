# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Messages and whole files that are compressed with zstd."""

from __future__ import annotations

import shutil
import sys
from pathlib import Path
from typing import Final

if sys.version_info >= (3, 14):
    from compression import zstd
else:
    from backports import zstd

# How each zstd frame begins. A ROS 2 message begins with a zero byte, so the bytes tell which is
# which, also in a file that has lost the metadata.yaml which says so.
_MAGIC: Final = b"\x28\xb5\x2f\xfd"


def expanded_message(raw: bytes) -> bytes:
    """Returns a ROS 2 message, decompressed if it was compressed by itself.

    Raises:
        ValueError: It is damaged.
    """
    if not raw.startswith(_MAGIC):
        return raw
    try:
        return zstd.decompress(raw)
    except zstd.ZstdError as error:
        raise ValueError(f"zstd data is damaged: {error}") from error


def expand_file(file: Path, target: Path) -> None:
    """Decompresses a file that is compressed as a whole.

    Raises:
        ValueError: It is damaged.
        OSError: It cannot be read, or there is no space left for its content.
    """
    try:
        with zstd.open(file, "rb") as content, target.open("wb") as plain:
            shutil.copyfileobj(content, plain)
    except (zstd.ZstdError, EOFError) as error:
        raise ValueError(f"zstd data is damaged: {error}") from error
