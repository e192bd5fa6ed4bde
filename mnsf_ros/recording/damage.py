# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Damage of a recording and its place."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mnsf_ros.errors import RecordingError, reason

# Tools that may mend a file, by words of its error.
_REMEDIES: Final = {
    "Bag index looks damaged": "the file may be cut short; 'rosbag reindex' may save the rest",
    "Bag is not indexed": "'rosbag reindex' may save what was written",
    "disk image is malformed": "'sqlite3 FILE .recover' may save a part",
    "file is not a database": "'sqlite3 FILE .recover' may save a part",
}


@dataclass(frozen=True)
class Damage:
    """Lost part of a recording.

    Attributes:
        file: The file or folder.
        position: Where in it, such as `byte 4711`; may be empty.
        text: Description.
        is_memory: Whether missing memory was the cause.
    """

    file: str
    position: str
    text: str
    is_memory: bool = False

    @classmethod
    def of(cls, file: Path, position: str, error: Exception, text: str) -> Damage:
        """Returns the damage described by a text and the error that is its reason."""
        cause = reason(error)
        remedies = [f" ({remedy})" for words, remedy in _REMEDIES.items() if words in cause]
        told = f"{text}: {cause}{''.join(remedies)}"
        return cls(str(file), position, told, isinstance(error, MemoryError))

    def __str__(self) -> str:
        """Returns one line for people."""
        return ", ".join(filter(None, (self.file, self.position))) + f": {self.text}"

    def error(self) -> RecordingError:
        """Returns an error with the same text; missing memory is its cause."""
        error = RecordingError(str(self))
        error.__cause__ = MemoryError() if self.is_memory else None
        return error
