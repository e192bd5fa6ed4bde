# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A recording, folder or single file, that appears complete or not at all."""

from __future__ import annotations

from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_files import MCAP, METADATA_NAME, SUFFIXES

if TYPE_CHECKING:
    from collections.abc import Iterator

_REPLACEABLE_SUFFIXES = (*SUFFIXES, ".zstd")


@contextmanager
def new_folder(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Yields the path of a draft; it is moved to `path` if the block ends well, else removed.

    Missing parents are made. If the path ends in `.mcap`, only the mcap file in the folder is moved
    there. With `overwrite` a recording that is there already is replaced, at the very end.

    Raises:
        RecordingError: Something is there already that may not be replaced.
        OSError: The folder cannot be made or moved.
    """
    check_target(path, overwrite=overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    is_file, prefix = path.suffix == MCAP, f".{path.name}."
    with TemporaryDirectory(prefix=prefix, suffix=".partial", dir=path.parent) as temporary:
        draft = Path(temporary, path.stem if is_file else path.name)
        yield draft
        if is_file:
            (draft,) = draft.glob(f"*{MCAP}")
        check_target(path, overwrite=overwrite)
        replaced = Path(temporary, f"{path.name}.replaced")
        if path.exists():
            path.rename(replaced)
        try:
            draft.rename(path)
        except BaseException:
            if replaced.exists():
                replaced.rename(path)
            raise


def check_target(path: Path, *, overwrite: bool) -> None:
    """Checks that a recording may be written, before any work is done for it.

    Raises:
        RecordingError: Something is there already that may not be replaced.
    """
    if not path.name:
        raise RecordingError(f"{str(path)!r}: is not the name of a folder, expected one to write")
    if path.suffix == MCAP and path.is_dir():
        raise RecordingError(f"{path}: is a folder, expected a file")
    if path.suffix in SUFFIXES and path.suffix != MCAP:
        raise RecordingError(f"{path}: a recording is a folder: leave out {path.suffix!r}")
    if not path.exists() and not path.is_symlink():
        return
    if not overwrite:
        raise RecordingError(f"{path}: exists already; --force replaces it")
    if path.suffix == MCAP:
        return
    # A wrong path must not cost anybody their other files.
    others = [path.name] if not path.is_dir() or path.is_symlink() else _other_files(path)
    if others:
        raise RecordingError(f"{path}: is not replaced: not a recording, or it holds {others[0]!r}")


def _other_files(folder: Path) -> list[str]:
    return sorted(
        entry.name
        for entry in folder.iterdir()
        if not entry.is_file()
        or (entry.name != METADATA_NAME and entry.suffix not in _REPLACEABLE_SUFFIXES)
    )
