"""What the bag libraries raise on files they cannot read, and one line of text for each."""

from __future__ import annotations

import struct
import sys
from typing import Final

import apsw
from rosbags.highlevel import AnyReaderError
from rosbags.rosbag1 import ReaderError as Ros1ReaderError
from rosbags.rosbag2 import ReaderError as Ros2ReaderError
from rosbags.serde import SerdeError
from rosbags.typesys import TypesysError

if sys.version_info >= (3, 14):
    from compression.zstd import ZstdError
else:
    from backports.zstd import ZstdError

# rosbags reports most damage with its own errors, but parses without a guard everywhere else:
# a damaged length, name or number then surfaces as the built-in error of the operation that
# stumbled over it. Catch this only around calls into rosbags, never around other code.
UNREADABLE: Final[tuple[type[Exception], ...]] = (
    AnyReaderError,
    Ros1ReaderError,
    Ros2ReaderError,
    SerdeError,
    TypesysError,
    ZstdError,
    apsw.Error,
    struct.error,
    OSError,
    EOFError,
    AssertionError,
    LookupError,
    TypeError,
    ValueError,
    OverflowError,
    MemoryError,
    RuntimeError,
)

# What to do about damage that a tool of the format's own may mend; by words of its error.
_REMEDIES: Final = {
    "end magic": "the file is cut short; 'mcap recover' may save what was written",
    "Bag index looks damaged": "the file may be cut short; 'rosbag reindex' may save the rest",
    "Bag is not indexed": "'rosbag reindex' may save what was written",
    "disk image is malformed": "'sqlite3 FILE .recover' may save a part",
}
_MAX_LENGTH: Final = 300


def reason(error: BaseException) -> str:
    """Return what went wrong as one line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        text = error.strerror
    else:
        # rosbags asks to report what its users cannot help: a version or plugin it does not know.
        text = " ".join(str(error).split()).replace("; please report issue", "")
        text = text[:_MAX_LENGTH].rstrip(".")
    known = isinstance(error, (AnyReaderError, Ros1ReaderError, Ros2ReaderError, OSError))
    if not known or not text:
        # The text of a built-in error, such as that of a KeyError, means little on its own.
        text = f"{type(error).__name__}: {text}" if text else type(error).__name__
    remedies = [remedy for words, remedy in _REMEDIES.items() if words in text]
    return f"{text} ({remedies[0]})" if remedies else text
