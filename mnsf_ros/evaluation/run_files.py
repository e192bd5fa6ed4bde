r"""The files of a run that are read and written as a whole; `run_rows.py` has those that grow.

They are UTF-8 in every locale. What cannot be encoded, as bytes of a path that are no text, is
written as `\udcff`, which is read back from JSON as it was.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.run_json import Kind, from_json


class WritingError(EvaluationError):
    """A file of a run cannot be written, as on a full disk; what was there before still is."""


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
    draft = file.with_name(f".{file.name}.new")
    with writing(file):
        try:
            with draft.open("w", encoding="utf-8", errors="backslashreplace") as stream:
                stream.writelines(parts)
                stream.flush()
                os.fsync(stream.fileno())
            draft.replace(file)
        finally:
            draft.unlink(missing_ok=True)


@contextmanager
def writing(file: Path) -> Iterator[None]:
    """Makes a WritingError of what goes wrong while a file is written."""
    try:
        yield
    except OSError as error:
        raise WritingError(f"{file}: cannot be written: {error.strerror or error}") from error
