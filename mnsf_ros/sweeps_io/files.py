# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Files of any origin: read or refused in one line, and written as a whole or not at all."""

from __future__ import annotations

import os
import secrets
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib.npyio import NpzFile
from numpy.typing import NDArray

from mnsf_ros.errors import UNREADABLE, MnsfError, reason


@contextmanager
def reading(path: Path, part: str = "", *, kind: type[MnsfError]) -> Iterator[None]:
    """Turns errors of parsers inside the block into one kind of error, with file and part.

    A named pipe or a device is refused before the block: reading it might never end.
    """
    try:
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise kind(f"{path}: is not a regular file")
        yield
    except (kind, ModuleNotFoundError):
        raise
    except FileNotFoundError as error:
        raise kind(f"{path}: no such file") from error
    except UNREADABLE as error:
        what = f"{part}: {reason(error)}" if part else reason(error)
        raise kind(f"{path}: cannot be read: {what}") from error


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


def read_npz(path: Path, required: Iterable[str]) -> dict[str, NDArray[Any]]:
    """Returns all arrays of an npz file; call it inside of `reading`.

    Raises:
        ValueError: It is no such file, a required array is missing, or one holds Python objects.
    """
    with path.open("rb") as file:
        archive = np.load(file, allow_pickle=False)
        if not isinstance(archive, NpzFile):
            raise ValueError("is a single array, expected an npz archive")
        with archive:
            found = ", ".join(archive.files) or "none"
            for name in required:
                if name not in archive.files:
                    raise ValueError(f"has no array {name!r}; it has {found}")
            return dict(archive.items())
