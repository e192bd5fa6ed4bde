# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Damage of a recording and its place, and the errors that libraries raise on damaged files."""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import apsw
from mcap.exceptions import McapError
from rosbags.highlevel import AnyReaderError
from rosbags.rosbag1 import ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError
from zstandard import ZstdError

from mnsf_ros.errors import RecordingError

# The libraries report most damage with errors of their own, but parse without a guard everywhere
# else: a damaged length, name or number surfaces as the built-in error of the operation that
# stumbled over it. Catch this only around calls into them, never around other code.
UNREADABLE: Final[tuple[type[Exception], ...]] = (
    AnyReaderError,
    ReaderError,
    SerdeError,
    TypesysError,
    McapError,
    ZstdError,
    apsw.Error,
    struct.error,
    OSError,
    EOFError,
    AssertionError,
    AttributeError,
    LookupError,
    TypeError,
    ValueError,
    OverflowError,
    MemoryError,
    RuntimeError,
)

_NO_MEMORY: Final = (MemoryError, apsw.NoMemError)
# Errors whose text says enough. That of another built-in error, such as a KeyError, means little.
_CLEAR: Final = (AnyReaderError, ReaderError, McapError, OSError, EOFError)
# Tools that may mend a file, by words of its error.
_REMEDIES: Final = {
    "Bag index looks damaged": "the file may be cut short; 'rosbag reindex' may save the rest",
    "Bag is not indexed": "'rosbag reindex' may save what was written",
    "disk image is malformed": "'sqlite3 FILE .recover' may save a part",
    "file is not a database": "'sqlite3 FILE .recover' may save a part",
}
_MAX_LENGTH: Final = 300


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
    def of(cls, file: Path, position: str, error: Exception, text: str = "") -> Damage:
        """Returns the damage described by an error; `text` comes before its reason."""
        told = f"{text}: {reason(error)}" if text else reason(error)
        return cls(str(file), position, told, isinstance(error, _NO_MEMORY))

    def __str__(self) -> str:
        """Returns one line for people."""
        return ", ".join(filter(None, (self.file, self.position))) + f": {self.text}"

    def error(self) -> RecordingError:
        """Returns an error with the same text; missing memory is its cause."""
        error = RecordingError(str(self))
        error.__cause__ = MemoryError() if self.is_memory else None
        return error


def reason(error: BaseException) -> str:
    """Returns the cause of an error as one line without a full stop."""
    if isinstance(error, _NO_MEMORY):
        return "it takes more memory than the limit"
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror
    else:
        # rosbags asks to report what its users cannot help: a version that it does not know.
        text = " ".join(str(error).split()).replace("; please report issue", "")
        text = text[:_MAX_LENGTH].rstrip(".")
    if not text or not isinstance(error, _CLEAR):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    remedies = [remedy for words, remedy in _REMEDIES.items() if words in text]
    return f"{text} ({remedies[0]})" if remedies else text


def unfit_counts(
    where: Path, promised: Mapping[str, int], found: Mapping[str, int]
) -> Iterator[Damage]:
    """Yields a Damage for each topic whose number of messages is not the one promised."""
    for topic in sorted({*promised, *found}):
        numbers = promised.get(topic, 0), found.get(topic, 0)
        if numbers[0] != numbers[1]:
            text = f"promises {numbers[0]} messages on {topic!r}, {numbers[1]} are stored"
            yield Damage(str(where), "", text)
