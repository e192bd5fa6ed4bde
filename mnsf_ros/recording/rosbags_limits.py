# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""rosbags with the project's limits on decompression and databases: it has none of its own.

The names below are all known places at which rosbags 0.11 decompresses, takes what a file claims,
parses YAML of a file, reads all of it because it has no index, or a part of it again and again.
They are replaced for the whole process. `test_decompression.py`, `test_file_budget.py`,
`test_hostile_databases.py` and `test_broken_recordings.py` in `tests/recording` try each of them.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextvars import ContextVar
from functools import partial
from itertools import accumulate
from typing import IO, TYPE_CHECKING, Any, BinaryIO, Final, NoReturn, TypeVar
from weakref import WeakKeyDictionary

import apsw
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag1 import reader as ros1_bags
from rosbags.rosbag2 import ReaderError, storage_mcap, storage_sqlite3
from rosbags.rosbag2 import reader as ros2_bags
from rosbags.rosbag2.metadata import parse_qos
from rosbags.rosbag2.storage_mcap import McapReader

from mnsf_ros.decompression import MAX_BYTES, FileBudget, LimitedFile, check_size, decompress
from mnsf_ros.errors import NoIndexError
from mnsf_ros.recording.bag_topics import has_latched_profile
from mnsf_ros.recording.mcap_parts import has_other_profile
from mnsf_ros.recording.sqlite_limits import limit_database

if TYPE_CHECKING:
    from collections.abc import Callable

Found = TypeVar("Found")

_READ_MCAP: Final = storage_mcap.read_exact
_READ_ROS1: Final = ros1_bags.read_bytes
_READ_RECORD: Final = storage_mcap.read_sized
_SKIP_RECORD: Final = storage_mcap.skip_sized
_PARSE_QOS: Final = parse_qos
_OPEN_MCAP: Final = McapReader._open
_READ_HEADER: Final = ros1_bags.Header.read
_READ_INDEX: Final = Ros1Reader.read_index_data
# What rosbags may hold at a time: chunks that overlap in time.
_MAX_OVERLAP_BYTES: Final = 2 * MAX_BYTES
# What was read of the index of a bag.
_INDEX_BYTES: Final = WeakKeyDictionary[Ros1Reader, int]()
_LATCHED_PROFILE: Final = Qos(
    QosHistory.UNKNOWN,
    0,
    QosReliability.UNKNOWN,
    QosDurability.TRANSIENT_LOCAL,
    *(QosTime(0, 0), QosTime(0, 0)),
    QosLiveliness.UNKNOWN,
    QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)

# That of the scan which asks for the next message; none while files are opened.
_BUDGET: Final[ContextVar[FileBudget | None]] = ContextVar("budget", default=None)


def next_within(budget: FileBudget, scan: Iterator[Found]) -> Found | None:
    """The next message of a scan, None at its end.

    What rosbags decompresses for it, and each record it meets there, is taken from the budget.
    """
    token = _BUDGET.set(budget)
    try:
        return next(scan, None)
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


def _plain(data: bytes, _claimed: int | None = None) -> bytes:
    """What is not compressed may be named by an index again and again."""
    if (budget := _BUDGET.get()) is not None:
        budget.spend(len(data))
    return data


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
    """The profiles of a topic; of those in a text only whether one is latched."""
    if not isinstance(profiles, str):
        return _PARSE_QOS(profiles)
    return [_LATCHED_PROFILE] if has_latched_profile(profiles) else []


def _open_mcap(reader: McapReader) -> None:
    try:
        _OPEN_MCAP(reader)
    except ReaderError as error:
        if reader.bio is not None and has_other_profile(reader.bio):
            raise NoIndexError(str(error)) from error
        raise
    if not any(count for chunk in reader.chunks for count in chunk.channel_count.values()):
        _refuse_scan(reader)
    if _overlap_bytes(reader) > _MAX_OVERLAP_BYTES:
        raise NoIndexError("too many chunks of a file overlap in time")


def _overlap_bytes(reader: McapReader) -> int:
    """The most bytes of chunks that overlap in time, by the index."""
    begins = ((chunk.message_start_time, chunk.uncompressed_size) for chunk in reader.chunks)
    ends = ((chunk.message_end_time + 1, -chunk.uncompressed_size) for chunk in reader.chunks)
    return max(accumulate(size for _, size in sorted((*begins, *ends))), default=0)


def _refuse_scan(reader: McapReader) -> None:
    """Reads nothing; a file without messages needs no index.

    Raises:
        NoIndexError: There may be messages in the file.
    """
    if reader.statistics is None or reader.statistics.message_count:
        raise NoIndexError("a file has no index of its messages")


def _read_header(*arguments: Any) -> ros1_bags.Header:  # noqa: ANN401
    _spend_record()
    return _READ_HEADER(*arguments)


def _read_index(reader: Ros1Reader, position: int, indexes: dict[int, list[Any]]) -> None:
    """Reads a part of the index; hostile ones lead to the same part again and again.

    Raises:
        ReaderError: What was read of it is larger than the file.
    """
    file: Any = reader.bio
    begin = file.tell()
    _READ_INDEX(reader, position, indexes)
    num_bytes = _INDEX_BYTES.get(reader, 0) + file.tell() - begin
    _INDEX_BYTES[reader] = num_bytes
    if num_bytes > os.fstat(file.fileno()).st_size:
        raise Ros1ReaderError("its index names more messages than there can be")


def _no_messages(*_: object) -> Iterator[NoReturn]:
    """Stands for the messages of a file that has none, as its statistics say."""
    return iter(())


def limit_rosbags() -> None:
    """Replaces what rosbags decompresses with; calling it again does nothing more."""
    storage_mcap.DECOMPRESSORS[""] = ros1_bags.decompressors["none"] = _plain
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
    vars(ros1_bags)["Header"].read = _read_header
    ros1: Any = Ros1Reader
    ros1.read_index_data = _read_index
    mcap: Any = McapReader
    mcap._open = _open_mcap
    mcap.meta_scan = _refuse_scan
    mcap.messages_scan = _no_messages
    if limit_database not in apsw.connection_hooks:
        apsw.connection_hooks.append(limit_database)
