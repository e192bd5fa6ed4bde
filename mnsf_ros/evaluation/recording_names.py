"""What recordings are called in results."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import chain, count
from pathlib import Path
from typing import Any

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.path_text import path_text
from mnsf_ros.evaluation.run_record import RecordingRecord
from mnsf_ros.recording.fingerprint import fingerprint, storage_files


def recording_names(paths: Sequence[Path], known: Sequence[RecordingRecord] = ()) -> list[str]:
    """Returns a name for each recording: the last part of its path, or all of it if need be.

    Args:
        paths: The recordings.
        known: Records of those that a run has already, see `run.json`. They keep their names,
            also where they have moved; others get a name that is free.

    Raises:
        EvaluationError: The same recording is named twice, in whatever spelling.
    """
    _check_each_once(paths)
    names = _known_names(paths, known)
    taken = {record.name for record in known}
    short = {path: short_name(path) for path in paths if path not in names}
    counts = Counter(chain(short.values(), taken))
    for path, name in short.items():
        names[path] = name if counts[name] == 1 else _free_name(path, taken)
        taken.add(names[path])
    return [names[path] for path in paths]


def _check_each_once(paths: Sequence[Path]) -> None:
    for path, times in Counter(paths).items():
        if times > 1:
            raise EvaluationError(f"{path}: is named {times} times")
    owners: dict[Path, Path] = {}
    for path in paths:
        for file in storage_files(path):
            owner = owners.setdefault(file, path)
            if owner != path:
                raise EvaluationError(f"{path}: is the same recording as {owner}; name it once")


def _known_names(paths: Sequence[Path], known: Sequence[RecordingRecord]) -> dict[Path, str]:
    """The names of recordings that a run has already."""
    left = {record.name: record for record in known}
    names: dict[Path, str] = {}
    # Read once: that is up to some megabytes of each file.
    contents = {path: _content(path) for path in paths if known}
    # Copies may lie side by side, and another recording where one was before it moved. One that
    # is like none, but lies or is called as one, is for `start_or_resume` to compare.
    for key_of_path, key_of_record in (
        (
            lambda path: (_files(path), contents[path]),
            lambda one: (_files(one.path), one.fingerprint),
        ),
        (contents.__getitem__, lambda one: one.fingerprint),
        (_files, lambda one: _files(one.path)),
        (short_name, lambda one: one.name),
    ):
        names_of = {repr(key_of_record(record)): name for name, record in left.items()}
        for path in (path for path in paths if path not in names and names_of):
            name = names_of.pop(repr(key_of_path(path)), None)
            if name is not None:
                names[path] = name
                del left[name]
    return names


def _files(path: Path | str) -> list[Path]:
    return storage_files(Path(path))


def _content(path: Path) -> dict[str, Any]:
    try:
        return fingerprint(path)
    except OSError:
        # Whoever reads it says why it cannot be read.
        return {}


def short_name(path: Path) -> str:
    """Returns the last part of a path."""
    return path_text(path.stem if path.is_file() else path.resolve().name)


def _free_name(path: Path, taken: set[str]) -> str:
    whole = path_text(path.resolve())
    names = chain((path_text(path), whole), (f"{whole} ({number})" for number in count(2)))
    return next(name for name in names if name not in taken)
