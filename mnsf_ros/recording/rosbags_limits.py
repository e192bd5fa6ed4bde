# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""rosbags with the project's limit on decompression: it has none of its own.

The names below are all the places at which rosbags 0.11 decompresses or takes what a file claims.
They are replaced for the whole process. `tests/recording/test_decompression.py` tries each of them.
"""

from __future__ import annotations

from functools import partial
from typing import IO, Any

import apsw
from rosbags.rosbag1 import reader as ros1_bags
from rosbags.rosbag2 import reader as ros2_bags
from rosbags.rosbag2 import storage_mcap

from mnsf_ros.decompression import MAX_BYTES, LimitedFile, decompress


class _LimitedZstd:
    """What rosbags uses of the module zstd: for whole files and for single messages."""

    @staticmethod
    def open(file: IO[bytes], _mode: str) -> LimitedFile:
        return LimitedFile(file)

    @staticmethod
    def decompress(data: bytes) -> bytes:
        return decompress("zstd", data)


def _limit_rows(connection: Any) -> None:  # noqa: ANN401
    """A table may be a view that makes up its rows."""
    connection.limit(apsw.SQLITE_LIMIT_LENGTH, MAX_BYTES)


def limit_rosbags() -> None:
    """Replaces what rosbags decompresses with; calling it again does nothing more."""
    for name in ("lz4", "zstd"):
        storage_mcap.DECOMPRESSORS[name] = partial(decompress, name)
    for name in ("bz2", "lz4"):
        ros1_bags.decompressors[name] = partial(decompress, name)
    vars(ros2_bags)["zstd"] = _LimitedZstd
    if _limit_rows not in apsw.connection_hooks:
        apsw.connection_hooks.append(_limit_rows)
