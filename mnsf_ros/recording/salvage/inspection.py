# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What is left in a recording that is damaged, has no index or is not in the order of time."""

from __future__ import annotations

from collections import Counter
from typing import TYPE_CHECKING, NamedTuple

from mnsf_ros.errors import NoIndexError, RecordingError
from mnsf_ros.recording.bag_files import MCAP, METADATA_NAME, ROS1, plain_files
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage, reason, unfit_counts
from mnsf_ros.recording.inspected import Inspection, Progress
from mnsf_ros.recording.metadata import read_metadata
from mnsf_ros.recording.salvage.salvage_reader import salvaged_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence
    from pathlib import Path


class _FileContent(NamedTuple):
    """What was found in one file: receive time of its first message, and as in Inspection."""

    file: Path
    first_ns: float
    topics: dict[str, TopicSummary]
    damages: list[Damage]
    has_checksums: bool


def inspect_damaged(
    path: Path,
    topics: dict[str, TopicSummary],
    problem: RecordingError | None,
    watch: Callable[[int, int], None] | None = None,
) -> Inspection:
    """Reads a recording once, around whatever is damaged, and says what can be used of it.

    Args:
        path: The recording.
        topics: What it holds by its index.
        problem: Why it cannot be opened, if it cannot.
        watch: See `inspect_recording`.

    Raises:
        RecordingError: No message of it can be read.
    """
    files = plain_files(path, MCAP)
    if problem is not None:
        # Of a ROS 1 bag that cannot be opened, the index is damaged or was never written.
        files = files or plain_files(path, ROS1)
        if not files:
            raise problem
    contents, found, damages = _read_files(files, watch)
    if not any(summary.count for summary in found.values()):
        raise problem or _nothing_readable(path, damages)
    is_as_indexed = _counts(found) == _counts(topics)
    if problem is None and not damages and not is_as_indexed:
        # Its metadata.yaml knows better which of the files belong to the recording.
        return Inspection(path, topics)
    if problem is not None and not damages:
        damages = [Damage(str(path), "", str(problem).removeprefix(f"{path}: "))]
    return _salvaged(path, contents, found, damages)


def _nothing_readable(path: Path, damages: Sequence[Damage]) -> RecordingError:
    causes = (f"{path}: holds no messages that can be read", *map(str, damages[:1]))
    return RecordingError("; ".join(causes))


def _counts(topics: dict[str, TopicSummary]) -> dict[str, tuple[str, int]]:
    return {name: (summary.msgtype, summary.count) for name, summary in topics.items()}


def inspect_unindexed(
    path: Path, problem: NoIndexError, watch: Callable[[int, int], None] | None = None
) -> Inspection:
    """Reads mcap files without an index once; that they have none is no damage.

    Args:
        path: The recording.
        problem: What opening it has shown.
        watch: See `inspect_recording`.

    Raises:
        RecordingError: No message of it can be read.
    """
    metadata = read_metadata(path)
    files = plain_files(path, MCAP) if metadata is None else metadata.files
    if not files or any(file.suffix != MCAP for file in files):
        raise RecordingError(f"{problem}; decompress its files first") from problem
    contents, found, damages = _read_files(files, watch)
    counts = Counter({topic: summary.count for topic, summary in found.items()})
    if not any(counts.values()):
        raise _nothing_readable(path, damages) from problem
    if metadata is not None:
        damages = [*unfit_counts(path / METADATA_NAME, metadata.counts, counts), *damages]
    return _salvaged(path, contents, found, damages)


def _salvaged(
    path: Path,
    contents: Sequence[_FileContent],
    topics: dict[str, TopicSummary],
    damages: Sequence[Damage],
) -> Inspection:
    return Inspection(
        path=path,
        topics=topics,
        damages=tuple(damages),
        has_checksums=all(content.has_checksums for content in contents),
        files=tuple(content.file for content in contents),
        needs_salvage=True,
    )


def inspect_ros1(
    path: Path, topics: dict[str, TopicSummary], watch: Callable[[int, int], None] | None = None
) -> Inspection:
    """Reads ROS 1 bags that can be opened once, and compares what is in them with their index.

    Where the index does not fit what they hold, they are read without it.
    """
    contents, found, damages = _read_files(plain_files(path, ROS1), watch)
    counts = [{name: one.count for name, one in of.items() if one.count} for of in (topics, found)]
    damages = damages or list(unfit_counts(path, *counts))
    is_unfit = counts[0] != counts[1] and sum(counts[1].values()) >= sum(counts[0].values())
    return Inspection(
        path=path,
        topics=found if is_unfit else topics,
        damages=tuple(damages),
        files=tuple(content.file for content in contents),
        needs_salvage=is_unfit,
    )


def _read_files(
    files: Sequence[Path], watch: Callable[[int, int], None] | None
) -> tuple[list[_FileContent], dict[str, TopicSummary], list[Damage]]:
    """What was found in each file, in the order of time, and topics and damages of all."""
    progress = Progress(files, watch)
    contents = sorted((_read_file(file, progress) for file in files), key=lambda one: one.first_ns)
    topics: dict[str, TopicSummary] = {}
    for content in contents:
        for name, summary in content.topics.items():
            known = topics.get(name, TopicSummary(summary.msgtype, 0))
            is_latched = known.is_latched or summary.is_latched
            topics[name] = TopicSummary(known.msgtype, known.count + summary.count, is_latched)
    damages = [damage for content in contents for damage in content.damages]
    return contents, dict(sorted(topics.items())), damages


def _read_file(file: Path, progress: Progress) -> _FileContent:
    """Reads a file from front to end, whatever its index says."""
    summary, messages = salvaged_messages(file)
    types = summary.types()
    counts: Counter[str] = Counter()
    latched: set[str] = set()
    damages: list[Damage] = []
    first_ns, has_checksums = float("inf"), True
    try:
        for message in messages:
            if isinstance(message, Damage):
                damages.append(message)
                continue
            progress.read(file, message.offset or 0)
            counts[message.topic] += 1
            types.setdefault(message.topic, message.msgtype)
            if message.is_latched:
                latched.add(message.topic)
            first_ns = min(first_ns, message.received_ns)
            has_checksums = has_checksums and message.is_verified
    except OSError as error:
        damages.append(Damage(str(file), "", f"cannot be read: {reason(error)}"))
    if not damages:
        for topic, promised in (summary.counts or {}).items():
            if topic in types and counts[topic] != promised:
                text = f"{counts[topic]} of {promised} messages on {topic!r} were found"
                damages.append(Damage(str(file), "", text))
    topics = {
        topic: TopicSummary(types[topic], counts[topic], topic in latched)
        for topic in sorted(types)
    }
    return _FileContent(file, first_ns, topics, damages, has_checksums)
