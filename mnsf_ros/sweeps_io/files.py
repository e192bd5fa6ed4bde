# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files of other people: read with one line of text for all that may be wrong with them."""

from __future__ import annotations

import importlib
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.decompression import check_size
from mnsf_ros.errors import MnsfError, SweepFileError

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


def parse_rows(text: bytes, num_rows: int, places: Sequence[int]) -> list[NDArray[Any]]:
    """Parses some columns, counted from 0, of the first rows of a text: (N,) float64 each.

    Raises:
        ValueError: There are fewer rows, a row is too short, or something is no number.
    """
    lines = [line for line in text.splitlines() if not line.isspace() and line][:num_rows]
    if len(lines) < num_rows:
        raise ValueError(f"is cut short: {len(lines)} of {num_rows} rows")
    if not lines:
        return [np.zeros(0) for _ in places]
    return list(np.loadtxt(lines, usecols=tuple(places), ndmin=2, comments=None).T)


@contextmanager
def reading(path: Path, part: str = "", kind: type[MnsfError] = SweepFileError) -> Iterator[None]:
    """Turns what parsers raise inside the block into one kind of error, with file and part.

    What is there but no regular file is refused before the block: a named pipe would keep it
    waiting for ever.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise kind(f"{path}: is not a regular file")
        yield
    except FileNotFoundError as error:
        raise kind(f"{path}: no such file") from error
    except UNREADABLE as error:
        what = f"{part}: {reason(error)}" if part else reason(error)
        raise kind(f"{path}: cannot be read: {what}") from error


def require(module: str, library: str = "") -> Any:  # noqa: ANN401
    """Imports a module of a library that only some formats need.

    Raises:
        ValueError: The library is not installed; the text has the command that helps.
    """
    library = library or module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if not f"{module}.".startswith(f"{error.name}."):
            raise
        raise ValueError(
            f"this format is read with {library}, which is not installed; "
            f"install it with: python -m pip install {library}"
        ) from error


def content_of(path: Path) -> bytes:
    """Returns all that is in a file; call it inside of `reading`.

    Raises:
        OSError: It cannot be read.
        SizeLimitError: It is larger than any cloud.
    """
    check_size(path.stat().st_size, "the file")
    return path.read_bytes()


def read_bytes(path: Path) -> bytes:
    """Returns the content of a file.

    Raises:
        SweepFileError: There is none, or it is empty or too large.
    """
    with reading(path):
        content = content_of(path)
    if not content:
        raise SweepFileError(f"{path}: is empty")
    return content
