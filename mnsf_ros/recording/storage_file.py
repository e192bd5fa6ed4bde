# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Base of the files of all formats: topics, messages, and damage with its place."""

from abc import ABC, abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, TypeAlias, TypeVar

from mnsf_ros.errors import RecordingError, reason
from mnsf_ros.recording.bag_topics import TopicSummary

Converted = TypeVar("Converted")

# Tools that may mend a file, by words of its error.
_REMEDIES: Final = {
    "Bag index looks damaged": "the file may be cut short; 'rosbag reindex' may save the rest",
    "Bag is not indexed": "'rosbag reindex' may save what was written",
    "disk image is malformed": "'sqlite3 FILE .recover' may save a part",
    "file is not a database": "'sqlite3 FILE .recover' may save a part",
}


@dataclass(frozen=True)
class Damage:
    """Lost part of a recording."""

    file: str  # or folder
    position: str  # in it, such as `byte 4711`; may be empty
    text: str
    is_memory: bool = False  # whether it was lost because memory was exhausted

    @classmethod
    def of(cls, file: Path, position: str, error: Exception, text: str) -> "Damage":
        """Returns the damage described by a text and the error that is its reason."""
        cause = reason(error)
        remedies = [f" ({remedy})" for words, remedy in _REMEDIES.items() if words in cause]
        whole = f"{text}: {cause}{''.join(remedies)}"
        return cls(str(file), position, whole, isinstance(error, MemoryError))

    def __str__(self) -> str:
        """Returns one line for people."""
        return ", ".join(filter(None, (self.file, self.position))) + f": {self.text}"

    def error(self) -> RecordingError:
        """Returns an error with the same text; its cause tells exhausted memory."""
        error = RecordingError(str(self))
        error.__cause__ = MemoryError() if self.is_memory else None
        return error


# A message with its receive time in nanoseconds, or damage.
Readable: TypeAlias = tuple[int, Converted] | Damage


class StorageFile(ABC):
    """A file with messages. Each scan opens it anew, so scans do not disturb each other.

    Raises:
        Exception: One of `UNREADABLE`, also in a scan: it is damaged or of another format.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self.topics: dict[str, TopicSummary] = {}  # only messages in CDR can be read
        # Receive times of the first and the last message.
        self.first_ns, self.last_ns = float("inf"), 0.0
        self.has_checksums = False  # whether flipped bits in the file are noticed
        self.damages: list[Damage] = []  # known before messages are read

    @abstractmethod
    def messages(self, topic: str, start_ns: float) -> Iterator[Readable[bytes]]:
        """Yields receive time and CDR bytes of the messages from a time on, or a Damage."""
