# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What is wrong with a recording, and where; and what the bag libraries raise on such files.

A recording without checksums can still contradict itself: in its counts, in its tables.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import apsw
from rosbags.highlevel import AnyReaderError
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag2 import ReaderError as Ros2ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError

from mnsf_ros.decompression import MAX_BYTES, DecompressionError
from mnsf_ros.recording.sqlite_limits import DatabaseLimitError

# rosbags reports most damage with its own errors, but parses without a guard everywhere else:
# a damaged length, name or number then surfaces as the built-in error of the operation that
# stumbled over it. Catch this only around calls into rosbags, never around other code.
UNREADABLE: Final[tuple[type[Exception], ...]] = (
    AnyReaderError,
    Ros1ReaderError,
    Ros2ReaderError,
    SerdeError,
    TypesysError,
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

# Errors whose text says enough. That of a built-in error, such as a KeyError, means little.
_CLEAR: Final = (
    AnyReaderError,
    Ros1ReaderError,
    Ros2ReaderError,
    OSError,
    DecompressionError,
    DatabaseLimitError,
)
# What to do about damage that a tool of the format's own may mend; by words of its error.
_REMEDIES: Final = {
    "end magic": "the file is cut short; 'mcap recover' may save what was written",
    "Bag index looks damaged": "the file may be cut short; 'rosbag reindex' may save the rest",
    "Bag is not indexed": "'rosbag reindex' may save what was written",
    "disk image is malformed": "'sqlite3 FILE .recover' may save a part",
    "string or blob too big": f"a message has more than {MAX_BYTES} bytes, which is the limit",
}
_MAX_LENGTH: Final = 300
# What is found by it, and what is said then. The first reads the whole file.
_CHECKS: Final = {
    "SELECT integrity_check FROM pragma_integrity_check WHERE integrity_check != 'ok' LIMIT 1": (
        "the database is damaged: {}"
    ),
    "SELECT count(*) AS number FROM messages "
    "WHERE topic_id NOT IN (SELECT id FROM topics) HAVING number > 0": (
        "messages that belong to no topic: {}"
    ),
}


@dataclass(frozen=True)
class Damage:
    """A part of a recording that is lost.

    Attributes:
        file: The file or folder.
        position: Where in it, such as `byte 4711`; may be empty.
        text: What was found there.
    """

    file: str
    position: str
    text: str

    def __str__(self) -> str:
        """Returns one line for people."""
        return ", ".join(filter(None, (self.file, self.position))) + f": {self.text}"


def reason(error: BaseException) -> str:
    """Returns what went wrong as one line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror
    else:
        # rosbags asks to report what its users cannot help: a version or plugin it does not know.
        text = " ".join(str(error).split()).replace("; please report issue", "")
        text = text[:_MAX_LENGTH].rstrip(".")
    if not text or not isinstance(error, _CLEAR):
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    remedies = [remedy for words, remedy in _REMEDIES.items() if words in text]
    return f"{text} ({remedies[0]})" if remedies else text


def unfit_counts(
    where: Path, promised: Mapping[str, int], found: Mapping[str, int]
) -> Iterator[Damage]:
    """Yields a Damage for each topic of which a file promises another number than there is."""
    for topic in sorted({*promised, *found}):
        numbers = promised.get(topic, 0), found.get(topic, 0)
        if numbers[0] != numbers[1]:
            text = f"promises {numbers[0]} messages on {topic!r}, {numbers[1]} are stored"
            yield Damage(str(where), "", text)


def unfit_database(file: str, database: apsw.Connection) -> Iterator[Damage]:
    """Yields a Damage for what does not fit together in an open database of rosbag2."""
    for query, text in _CHECKS.items():
        try:
            found = [text.format(" ".join(str(row[0]).split())) for row in database.execute(query)]
        except apsw.Error as error:
            found = [f"the database cannot be checked: {reason(error)}"]
        for one in found:
            yield Damage(file, "", one)
