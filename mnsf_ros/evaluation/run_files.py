# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
r"""Files of a run: each is there as a whole at any time, or grows by whole lines.

All are UTF-8 in every locale. What cannot be encoded, as bytes of a path that are no text, is
written as `\udcff`, which is read back from JSON as it was.
"""

from __future__ import annotations

import fcntl
import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.run_json import Kind, from_json, to_json

RUN_FILE: Final = "run.json"
ROWS_FILE: Final = "rows.jsonl"
TASKS_FILE: Final = "tasks.jsonl"
_LOCK_FILE: Final = ".lock"
_DRAFT: Final = ".{}.new"
# What a run leaves that was killed before it was written down.
_START: Final = {_LOCK_FILE, _DRAFT.format(RUN_FILE)}


class WritingError(EvaluationError):
    """A file of a run cannot be written, as on a full disk; what was there before still is."""


def check_folder(out: Path, *, resume: bool) -> None:
    """Makes sure that nothing would be overwritten.

    Raises:
        EvaluationError: The folder holds something and `resume` is not set, or is none.
    """
    if out.exists() and not out.is_dir():
        raise EvaluationError(f"{out}: is not a folder")
    if holds_something(out) and not resume:
        raise EvaluationError(f"{out}: exists already; name another folder, or add --resume")


def holds_something(out: Path) -> bool:
    """Returns whether there is more in a folder than what a run that never began leaves."""
    return out.is_dir() and any(entry.name not in _START for entry in out.iterdir())


def remove_if_unused(folder: Path) -> None:
    """Takes the folder of a run away if it holds nothing but the start of one."""
    start = {RUN_FILE, *_START}
    if {entry.name for entry in folder.iterdir()} <= start:
        for name in start:
            (folder / name).unlink(missing_ok=True)
        folder.rmdir()


@contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Makes a folder if there is none, and keeps other processes from writing to it.

    Raises:
        EvaluationError: Another process is at it.
        WritingError: It cannot be made.
    """
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    with (folder / _LOCK_FILE).open("a", encoding="utf-8") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            raise EvaluationError(f"{folder}: another process is writing to it") from error
        yield


def read_json(file: Path, kind: type[Kind]) -> Kind:
    """Returns the typed object that a file holds.

    Raises:
        EvaluationError: It cannot be read, or holds something else.
    """
    try:
        text = file.read_text(encoding="utf-8")
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{file}: cannot be read: {error}") from error
    try:
        return from_json(text, kind)
    except EvaluationError as error:
        raise EvaluationError(f"{file}: {error}") from error


def replace_file(file: Path, parts: Iterable[str]) -> None:
    """Writes a file so that it is there as a whole, the old or the new one, at any time.

    Raises:
        WritingError: That fails; the old file is still there.
    """
    draft = file.with_name(_DRAFT.format(file.name))
    with writing(file):
        try:
            with draft.open("w", encoding="utf-8", errors="backslashreplace") as stream:
                stream.writelines(parts)
                stream.flush()
                os.fsync(stream.fileno())
            draft.replace(file)
        finally:
            draft.unlink(missing_ok=True)


def append_line(file: Path, value: object) -> None:
    """Adds a typed object as one line of JSON.

    Raises:
        WritingError: That fails.
    """
    line = to_json(value)
    with writing(file), file.open("a", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(f"{line}\n")


@contextmanager
def writing(file: Path) -> Iterator[None]:
    """Makes a WritingError of what goes wrong while a file or folder is written."""
    try:
        yield
    except OSError as error:
        raise WritingError(f"{file}: cannot be written: {error.strerror or error}") from error


def read_lines(file: Path, kind: type[Kind]) -> Iterator[Kind]:
    """Yields the typed objects of a file, one of each line; none if there is no file.

    Raises:
        EvaluationError: It cannot be read, or a line holds something else.
    """
    number = 0
    try:
        for line in _lines(file):
            number += 1
            yield from_json(line, kind)
    except EvaluationError as error:
        raise EvaluationError(f"{file}, line {number}: {error}") from error


def cut_off_unfinished_line(file: Path) -> None:
    """Takes away what was being written when a process was killed."""
    replace_file(file, (f"{line}\n" for line in _lines(file)))


def _lines(file: Path) -> Iterator[str]:
    """The complete lines of a file; a last one without an end was being written and is lost."""
    try:
        # One at a time: the rows of many recordings are too much for the memory.
        with file.open(encoding="utf-8", newline="\n") as stream:
            for line in stream:
                if line.endswith("\n"):
                    yield line[:-1]
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{file}: cannot be read: {error}") from error
