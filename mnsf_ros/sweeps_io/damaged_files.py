"""What parsers raise on damaged files, whatever their format, and one line that says it."""

from __future__ import annotations

import struct
import tokenize
import zipfile
import zlib
from typing import Final

# LookupError and TypeError: on files laid out otherwise. MemoryError: a damaged header may ask for
# any size. SyntaxError: NumPy parses headers as Python source, and XML errors are of this kind.
UNREADABLE: Final = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    ArithmeticError,
    MemoryError,
    RuntimeError,
    SyntaxError,
    struct.error,
    tokenize.TokenError,
    zlib.error,
    zipfile.BadZipFile,
)
_MAX_LENGTH: Final = 200


def reason(error: BaseException) -> str:
    """Returns what an error says, in one short line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split())[:_MAX_LENGTH].rstrip(".")
    if isinstance(error, LookupError):
        # A KeyError's text is only the key.
        return f"it has no {text}" if isinstance(error, KeyError) else f"index error: {text}"
    return text or type(error).__name__
