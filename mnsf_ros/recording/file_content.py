"""What one storage file really holds, whatever its index says."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from pathlib import Path

from mnsf_ros.recording.bag_errors import reason
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.mcap_summary import read_summary
from mnsf_ros.recording.stored_messages import ENCODINGS, stored_messages


@dataclass(frozen=True)
class FileContent:
    """What was found in one file.

    Attributes:
        file: The file.
        first_ns: Receive time of the earliest message, nanoseconds; infinite without any.
        topics: Topic -> type and number of messages that can be decoded.
        damages: What cannot be read.
        has_checksums: Whether every message is covered by a checksum.
    """

    file: Path
    first_ns: float
    topics: dict[str, TopicSummary]
    damages: tuple[Damage, ...]
    has_checksums: bool

    @staticmethod
    def merged_topics(contents: Iterable[FileContent]) -> dict[str, TopicSummary]:
        """Returns the topics of several files together, sorted by name."""
        merged: dict[str, TopicSummary] = {}
        for content in contents:
            for topic, summary in content.topics.items():
                known = merged.get(topic, TopicSummary(summary.msgtype, 0))
                merged[topic] = TopicSummary(known.msgtype, known.count + summary.count)
        return dict(sorted(merged.items()))


def read_content(file: Path, watch: Callable[[int], None]) -> FileContent:
    """Reads a file from front to end.

    Args:
        file: An mcap file or a ROS 1 bag.
        watch: Called with the number of bytes read, again and again.
    """
    summary = read_summary(file)
    channels = [channel for channel in summary.channels.values() if channel.encoding in ENCODINGS]
    types = {channel.topic: channel.msgtype for channel in channels}
    counts: Counter[str] = Counter()
    damages: list[Damage] = []
    first_ns, has_checksums = float("inf"), True
    try:
        for message in stored_messages(file, summary):
            if isinstance(message, Damage):
                damages.append(message)
                continue
            watch(message.offset)
            if message.channel.encoding in ENCODINGS:
                counts[message.channel.topic] += 1
                types.setdefault(message.channel.topic, message.channel.msgtype)
                first_ns = min(first_ns, message.received_ns)
                has_checksums = has_checksums and message.is_verified
    except OSError as error:
        damages.append(Damage(str(file), "", f"cannot be read: {reason(error)}"))
    if not damages:
        for topic, promised in (summary.counts or {}).items():
            if topic in types and counts[topic] != promised:
                text = f"{counts[topic]} of {promised} messages on {topic!r} were found"
                damages.append(Damage(str(file), "", text))
    topics = {topic: TopicSummary(types[topic], counts[topic]) for topic in sorted(types)}
    return FileContent(file, first_ns, topics, tuple(damages), has_checksums)
