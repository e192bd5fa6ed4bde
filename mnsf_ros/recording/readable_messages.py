"""The messages of a topic as far as they can be read."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.sequential_reader import SequentialReader

if TYPE_CHECKING:
    from collections.abc import Iterator

    from mnsf_ros.recording.bag_reader import BagReader


def readable_messages(reader: BagReader, topic: str) -> Iterator[tuple[int, Any] | Damage]:
    """Yields receive time (nanoseconds) and message of all messages that can be read.

    Args:
        reader: An open recording.
        topic: One of its topics.

    Yields:
        Pairs, and a Damage wherever messages may be missing. Only mcap files go on after it.

    Raises:
        RecordingError: The topic is unknown.
    """
    if isinstance(reader, SequentialReader):
        yield from reader.messages_and_damages(topic)
        return
    scan = reader.received_messages(topic)
    while True:
        try:
            found = next(scan, None)
        except RecordingError as error:
            yield Damage(str(reader.path), "", str(error).removeprefix(f"{reader.path}: "))
            return
        if found is None:
            return
        yield found
