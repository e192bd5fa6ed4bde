# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What is in a recording: found out by reading all of it once, or opened by its index."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final, NamedTuple

from mcap.opcode import Opcode
from mcap.records import Chunk, MessageIndex
from mcap.stream_reader import StreamReader

from mnsf_ros.decompression import MAX_BYTES, FileBudget
from mnsf_ros.errors import NoIndexError, RecordingError
from mnsf_ros.recording.bag_files import MCAP, ROS1, plain_files
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.inspected import Inspection, Progress
from mnsf_ros.recording.mcap_parts import (
    MCAP_UNREADABLE,
    MESSAGE_HEAD,
    Summary,
    chunk_content,
    read_summary,
    records_in,
)

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

_MAX_WARNINGS: Final = 5


def inspect_recording(
    path: Path | str, watch: Callable[[int, int], None] | None = None
) -> Inspection:
    """Reads a recording once and says what can be used of it.

    Args:
        path: A rosbag2 folder, or a .mcap, .db3 or .bag file.
        watch: Called with the number of bytes read and that of all, again and again.

    Raises:
        RecordingError: There is none, or no message of it can be read.
    """
    path = Path(path)
    topics: dict[str, TopicSummary] = {}
    contradictions: tuple[Damage, ...] = ()
    problem: RecordingError | None = None
    try:
        with BagReader(path) as reader:
            topics, contradictions = reader.topics, reader.contradictions()
        with suppress(*MCAP_UNREADABLE):
            return _with(_of_opened(path, topics, watch), contradictions)
    except NoIndexError as error:
        from mnsf_ros.recording.salvage.inspection import inspect_unindexed

        return inspect_unindexed(path, error, watch)
    except RecordingError as error:
        problem = error
    from mnsf_ros.recording.salvage.inspection import inspect_damaged

    return _with(inspect_damaged(path, topics, problem, watch), contradictions)


@contextmanager
def open_recording(path: Path | str, warn: Callable[[str], None]) -> Iterator[BagReader]:
    """Opens a recording by its index; if that cannot be done, reads it once and opens what is left.

    Args:
        path: See `inspect_recording`.
        warn: Called with what cannot be read, as far as it is known then: a few lines.

    Raises:
        RecordingError: There is none, or no message of it can be read.
    """
    with ExitStack() as stack:
        try:
            reader = stack.enter_context(BagReader(path))
        except RecordingError:
            inspection = inspect_recording(path)
            for damage in inspection.damages[:_MAX_WARNINGS]:
                warn(str(damage))
            if (more := len(inspection.damages) - _MAX_WARNINGS) > 0:
                warn(f"{path}: and {more} more")
            reader = stack.enter_context(inspection.open())
        yield reader


def _with(inspection: Inspection, damages: tuple[Damage, ...]) -> Inspection:
    return replace(inspection, damages=(*damages, *inspection.damages))


def _of_opened(
    path: Path, topics: dict[str, TopicSummary], watch: Callable[[int, int], None] | None
) -> Inspection:
    if files := plain_files(path, MCAP):
        return _of_mcap(path, topics, files, watch)
    if plain_files(path, ROS1):
        from mnsf_ros.recording.salvage.inspection import inspect_ros1

        return inspect_ros1(path, topics, watch)
    return Inspection(path, topics)


class _IrregularError(ValueError):
    """A file has no full index that fits, or its messages are not in the order of time."""


def _of_mcap(
    path: Path,
    topics: dict[str, TopicSummary],
    files: Sequence[Path],
    watch: Callable[[int, int], None] | None,
) -> Inspection:
    progress = Progress(files, watch)
    checked = sorted((_checked(file, progress) for file in files), key=lambda one: one.first_ns)
    counts = sum((one.counts for one in checked), Counter[str]())
    if counts != {topic: summary.count for topic, summary in topics.items() if summary.count}:
        # Its metadata.yaml knows better which of the files belong to the recording.
        return Inspection(path, topics)
    # rosbags sorts by receive time. Where the clock of the recorder jumped back, that would mix
    # sweeps from before and after the jump.
    if any(former.last_ns > latter.first_ns for former, latter in pairwise(checked)):
        raise _IrregularError
    has_checksums = all(one.has_checksums for one in checked)
    in_order = tuple(one.file for one in checked)
    return Inspection(path, topics, has_checksums=has_checksums, files=in_order)


class _CheckedFile(NamedTuple):
    """A file in good order: receive times of first and last message, and messages of each topic."""

    file: Path
    first_ns: float
    last_ns: float
    counts: Counter[str]
    has_checksums: bool


def _checked(file: Path, progress: Progress) -> _CheckedFile:
    """Reads a file from front to end, and compares it with its index and checksums.

    Raises:
        Exception: One of `MCAP_UNREADABLE`: it is damaged, or cannot be read by its index.
    """
    summary = read_summary(file)
    if not summary.is_complete:
        raise _IrregularError
    budget = FileBudget(file.stat().st_size, "the mcap file")
    counts: Counter[str] = Counter()
    first_ns, last_ns = float("inf"), float("-inf")
    num_chunks, num_indexes, has_checksums = 0, 0, True
    with file.open("rb") as stream:
        # A larger record is named by the salvage reader.
        reader = StreamReader(stream, emit_chunks=True, record_size_limit=MAX_BYTES)
        for record in reader.records:
            num_indexes += isinstance(record, MessageIndex)
            if not isinstance(record, Chunk):
                continue
            progress.read(file, stream.tell())
            num_chunks += 1
            for topic, received_ns in _messages_in(record, summary, budget):
                if received_ns < last_ns:
                    raise _IrregularError
                counts[topic] += 1
                first_ns, last_ns = min(first_ns, received_ns), received_ns
                has_checksums = has_checksums and record.uncompressed_crc != 0
    # What is not serialized as ROS 2 does it cannot be read, and counts for nothing.
    readable = summary.types()
    promised = Counter({t: count for t, count in (summary.counts or {}).items() if t in readable})
    if counts != promised or (num_chunks, num_indexes) != summary.num_parts:
        raise _IrregularError
    return _CheckedFile(file, first_ns, last_ns, counts, has_checksums)


def _messages_in(chunk: Chunk, summary: Summary, budget: FileBudget) -> Iterator[tuple[str, int]]:
    """Yields topic and receive time of the messages in a chunk that ROS 2 can read."""
    for opcode, payload in records_in(chunk_content(chunk, budget), budget):
        if opcode == Opcode.MESSAGE:
            number, _, received_ns, _ = MESSAGE_HEAD.unpack_from(payload)
            channel = summary.channels[number]
            if channel.message_encoding == "cdr":
                yield channel.topic, received_ns
