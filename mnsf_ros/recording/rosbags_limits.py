# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""rosbags with the project's limits on decompression and databases: it has none of its own.

The names below are all the places at which rosbags 0.11 decompresses or takes what a file claims.
They are replaced for the whole process. `test_decompression.py` and `test_hostile_databases.py` in
`tests/recording` try each of them.
"""

from __future__ import annotations

from functools import partial
from typing import IO, TYPE_CHECKING, BinaryIO, Final

import apsw
from rosbags.rosbag1 import reader as ros1_bags
from rosbags.rosbag2 import reader as ros2_bags
from rosbags.rosbag2 import storage_mcap

from mnsf_ros.decompression import LimitedFile, check_size, decompress
from mnsf_ros.recording.sqlite_limits import limit_database

if TYPE_CHECKING:
    from collections.abc import Callable

_READ_MCAP: Final = storage_mcap.read_exact
_READ_ROS1: Final = ros1_bags.read_bytes


class _LimitedZstd:
    """What rosbags uses of the module zstd: for whole files and for single messages."""

    @staticmethod
    def open(file: IO[bytes], _mode: str) -> LimitedFile:
        return LimitedFile(file)

    @staticmethod
    def decompress(data: bytes) -> bytes:
        return decompress("zstd", data)


def _read_limited(read: Callable[[BinaryIO, int], bytes], file: BinaryIO, size: int) -> bytes:
    """Reads a part of a file, of which only the file says how long it is."""
    check_size(size, "this record")
    return read(file, size)


def limit_rosbags() -> None:
    """Replaces what rosbags decompresses with; calling it again does nothing more."""
    for name in ("lz4", "zstd"):
        storage_mcap.DECOMPRESSORS[name] = partial(decompress, name)
    for name in ("bz2", "lz4"):
        ros1_bags.decompressors[name] = partial(decompress, name)
    vars(storage_mcap)["read_exact"] = partial(_read_limited, _READ_MCAP)
    vars(ros1_bags)["read_bytes"] = partial(_read_limited, _READ_ROS1)
    vars(ros2_bags)["zstd"] = _LimitedZstd
    if limit_database not in apsw.connection_hooks:
        apsw.connection_hooks.append(limit_database)
