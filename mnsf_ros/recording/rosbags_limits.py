# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""rosbags with the project's limits on decompression and databases: it has none of its own.

The names below are all the places at which rosbags 0.11 decompresses, takes what a file claims,
parses YAML of a file, or reads all of it because it has no index. They are replaced for the whole
process. `test_decompression.py`, `test_file_budget.py`, `test_hostile_databases.py` and
`test_broken_recordings.py` in `tests/recording` try each of them.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from functools import partial
from typing import IO, TYPE_CHECKING, Any, BinaryIO, Final, NoReturn

import apsw
from rosbags.rosbag1 import reader as ros1_bags
from rosbags.rosbag2 import ReaderError, storage_mcap, storage_sqlite3
from rosbags.rosbag2 import reader as ros2_bags
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import McapReader
from ruamel.yaml.error import YAMLError

from mnsf_ros.decompression import FileBudget, LimitedFile, check_size, decompress
from mnsf_ros.errors import NoIndexError
from mnsf_ros.recording.mcap_parts import has_other_profile
from mnsf_ros.recording.metadata import check_expansion
from mnsf_ros.recording.sqlite_limits import limit_database

if TYPE_CHECKING:
    from collections.abc import Callable

_READ_MCAP: Final = storage_mcap.read_exact
_READ_ROS1: Final = ros1_bags.read_bytes
_READ_RECORD: Final = storage_mcap.read_sized
_SKIP_RECORD: Final = storage_mcap.skip_sized
_PARSE_QOS: Final = parse_qos
_OPEN_MCAP: Final = McapReader._open

# That of the scan which asks for the next message; none while files are opened.
_BUDGET: Final[ContextVar[FileBudget | None]] = ContextVar("budget", default=None)


@contextmanager
def limited_to(budget: FileBudget) -> Iterator[None]:
    """Takes what rosbags decompresses meanwhile, and each record it meets there, from a budget."""
    token = _BUDGET.set(budget)
    try:
        yield
    finally:
        _BUDGET.reset(token)


class _LimitedZstd:
    """What rosbags uses of the module zstd: for whole files and for single messages."""

    @staticmethod
    def open(file: IO[bytes], _mode: str) -> LimitedFile:
        return LimitedFile(file)

    @staticmethod
    def decompress(data: bytes) -> bytes:
        return decompress("zstd", data)


def _decompress(compression: str, data: bytes, claimed: int | None = None) -> bytes:
    return decompress(compression, data, claimed, budget=_BUDGET.get())


def _read_limited(read: Callable[[BinaryIO, int], bytes], file: BinaryIO, size: int) -> bytes:
    """Reads a part of a file, of which only the file says how long it is."""
    check_size(size, "this record")
    return read(file, size)


def _read_record(chunk: BinaryIO) -> bytes:
    _spend_record()
    return _READ_RECORD(chunk)


def _skip_record(chunk: BinaryIO) -> None:
    _spend_record()
    _SKIP_RECORD(chunk)


def _spend_record() -> None:
    if (budget := _BUDGET.get()) is not None:
        budget.spend_record()


def _parse_qos(profiles: Any) -> Any:  # noqa: ANN401
    """Parses the profiles of a topic: YAML in a text, or what metadata.yaml already holds."""
    if isinstance(profiles, str):
        # rosbags itself says what is no YAML.
        with suppress(YAMLError):
            check_expansion(profiles)
    return _PARSE_QOS(profiles)


def _open_mcap(reader: McapReader) -> None:
    try:
        _OPEN_MCAP(reader)
    except ReaderError as error:
        if reader.bio is not None and has_other_profile(reader.bio):
            raise NoIndexError(str(error)) from error
        raise
    if not any(count for chunk in reader.chunks for count in chunk.channel_count.values()):
        _refuse_scan(reader)


def _refuse_scan(reader: McapReader) -> None:
    """Reads nothing; a file without messages needs no index.

    Raises:
        NoIndexError: There may be messages in the file.
    """
    if reader.statistics is None or reader.statistics.message_count:
        raise NoIndexError("a file has no index of its messages")


def _no_messages(*_: object) -> Iterator[NoReturn]:
    """Stands for the messages of a file that has none, as its statistics say."""
    return iter(())


def limit_rosbags() -> None:
    """Replaces what rosbags decompresses with; calling it again does nothing more."""
    for name in ("lz4", "zstd"):
        storage_mcap.DECOMPRESSORS[name] = partial(_decompress, name)
    for name in ("bz2", "lz4"):
        ros1_bags.decompressors[name] = partial(_decompress, name)
    vars(storage_mcap)["read_exact"] = partial(_read_limited, _READ_MCAP)
    vars(storage_mcap)["read_sized"] = _read_record
    vars(storage_mcap)["skip_sized"] = _skip_record
    vars(ros1_bags)["read_bytes"] = partial(_read_limited, _READ_ROS1)
    vars(ros2_bags)["zstd"] = _LimitedZstd
    for module in (ros2_bags, storage_mcap, storage_sqlite3):
        vars(module)["parse_qos"] = _parse_qos
    methods: Any = McapReader
    methods._open = _open_mcap
    methods.meta_scan = _refuse_scan
    methods.messages_scan = _no_messages
    if limit_database not in apsw.connection_hooks:
        apsw.connection_hooks.append(limit_database)
