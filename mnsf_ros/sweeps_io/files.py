# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Reading files of any origin: every failure becomes one error of one line."""

from __future__ import annotations

import importlib
import os
import secrets
import struct
import tokenize
import zipfile
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from mnsf_ros.errors import MnsfError

# LookupError, TypeError and AttributeError: the file has another structure. MemoryError: a damaged
# header may ask for any size. SyntaxError: NumPy parses headers as Python source, and XML errors
# are of this kind.
UNREADABLE: Final = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    TypeError,
    AttributeError,
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
    """Returns the text of an error as one short line without a full stop."""
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    text = " ".join(str(error).split())[:_MAX_LENGTH].rstrip(".")
    if isinstance(error, LookupError):
        # A KeyError's text is only the key.
        return f"it has no {text}" if isinstance(error, KeyError) else f"index error: {text}"
    return text or type(error).__name__


@contextmanager
def reading(path: Path, part: str = "", *, kind: type[MnsfError]) -> Iterator[None]:
    """Turns errors of parsers inside the block into one kind of error, with file and part.

    A named pipe or a device is refused before the block: reading it might never end.
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


def require(module: str) -> Any:  # noqa: ANN401
    """Imports a module of a library that only some formats need.

    Raises:
        ValueError: The library is not installed; the text has the command that installs it.
    """
    library = module.partition(".")[0]
    try:
        return importlib.import_module(module)
    except ModuleNotFoundError as error:
        if not f"{module}.".startswith(f"{error.name}."):
            raise
        raise ValueError(
            f"this format is read with {library}, which is not installed; "
            f"install it with: python -m pip install {library}"
        ) from error


@contextmanager
def new_file(path: Path, kind: type[MnsfError], *, overwrite: bool) -> Iterator[Path]:
    """Draft of a file beside it; moved there when the block ends well, else removed.

    Raises:
        MnsfError: Of the given kind: the file exists, its folder is missing, or it cannot be
            written.
    """
    check_new_file(path, kind, overwrite=overwrite)
    draft = path.with_name(f".{path.name}.{secrets.token_hex(4)}.new")
    try:
        yield draft
        with draft.open("rb+") as stream:
            os.fsync(stream.fileno())
        check_new_file(path, kind, overwrite=overwrite)
        draft.replace(path)
    except OSError as error:
        raise kind(f"{path}: cannot be written: {reason(error)}") from error
    finally:
        draft.unlink(missing_ok=True)


def check_new_file(path: Path, kind: type[MnsfError], *, overwrite: bool) -> None:
    """Checks before any work whether a file can be written.

    Raises:
        MnsfError: Of the given kind: the file exists, or its folder is missing.
    """
    if path.is_dir() or (path.exists() and not overwrite):
        raise kind(f"{path}: exists already; --force replaces it")
    if not path.absolute().parent.is_dir():
        raise kind(f"{path}: there is no folder {path.parent}")


@contextmanager
def open_npz(path: Path) -> Iterator[NpzFile]:
    """Opens an npz file; call it inside of `reading`.

    Raises:
        ValueError: The file holds a single array, as npy files do.
    """
    with path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        if not isinstance(archive, NpzFile):
            raise ValueError("is a single array, expected an npz archive")
        with archive:
            yield archive


def array_in(archive: NpzFile, name: str) -> NDArray[Any]:
    """Returns an array of an npz file.

    Raises:
        ValueError: There is none of that name, or it holds Python objects.
    """
    if name not in archive.files:
        raise ValueError(f"has no array {name!r}; it has {', '.join(archive.files) or 'none'}")
    array: NDArray[Any] = archive[name]
    return array
