# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The recordings of a run: what is in them, which topics are used, and what they are called."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from itertools import chain, count
from pathlib import Path
from typing import Any, NamedTuple

from mnsf_ros.errors import EvaluationError, RecordingError
from mnsf_ros.recording.bag_files import fingerprint, storage_files
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import used_topics
from mnsf_ros.recording.inspected import Inspection
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.setting import SettingValue


def path_text(path: Path | str) -> str:
    r"""Returns a path, or text with paths in it, as text that every file and terminal can hold.

    Python keeps the bytes of a file name that its locale cannot decode as lone surrogates. Those
    that are UTF-8 after all are decoded, so that the text is the same in every locale; the others
    are shown as `\xff`.
    """
    return str(path).encode("utf-8", "surrogateescape").decode("utf-8", "backslashreplace")


@dataclass(frozen=True)
class EvaluatedRecording:
    """A recording and the topics that are used of it.

    Attributes:
        name: What it is called in results.
        path: Where it is, or was in an earlier run.
        points: Topic of the sweeps.
        truth: Topic of the true flow; None if there is none.
        odometry: Topic of the sensor's poses; None if there is none.
        num_sweeps: Number of sweeps that are stored.
        has_checksums: Whether flipped bits within a message would have been noticed.
        damages: What could not be read.
        fingerprint: See `recording.bag_files`; None in runs of early versions.
        inspection: What reading it once has shown; None of one of an earlier run.
    """

    name: str
    path: str
    points: str
    truth: str | None
    odometry: str | None
    num_sweeps: int
    has_checksums: bool
    damages: list[str]
    fingerprint: dict[str, SettingValue] | None = None
    inspection: Inspection | None = None

    @property
    def identity(self) -> dict[str, object]:
        """Name to value of all that must not change while a run lasts; it may move."""
        told = {name: getattr(self, name) for name in ("points", "truth", "odometry", "num_sweeps")}
        content = self.fingerprint or {}
        return told | {f"fingerprint: {name}": value for name, value in content.items()}

    @contextmanager
    def open(self) -> Iterator[BagReader]:
        """Opens the recording; one of an earlier run is inspected first.

        Raises:
            RecordingError: It cannot be read, or has changed since it was inspected.
        """
        with (self.inspection or inspect_recording(self.path)).open() as reader:
            yield reader


def choose_topics(
    inspection: Inspection,
    name: str,
    points: str | None = None,
    truth: str | None = None,
    odometry: str | None = None,
) -> EvaluatedRecording:
    """Finds out which topics of a recording to use.

    Topics that are None are chosen: the only one that can be that of the sweeps; truth and
    odometry as in `docs/recordings.md`, if they are there.

    Raises:
        RecordingError: There is no such topic, or there are several to choose from.
        OSError: The recording cannot be read any more.
    """
    used = used_topics(inspection.path, inspection.topics, points, truth, odometry)
    return EvaluatedRecording(
        name=name,
        path=str(inspection.path.resolve()),
        points=used.points,
        truth=used.truth,
        odometry=used.odometry,
        num_sweeps=inspection.topics[used.points].count,
        has_checksums=inspection.has_checksums,
        damages=[path_text(str(damage)) for damage in inspection.damages],
        fingerprint=fingerprint(inspection.path),
        inspection=inspection,
    )


Watch = Callable[[int, int], None]


def inspected_recordings(
    paths: Sequence[Path],
    known: Sequence[EvaluatedRecording],
    *topics: str | None,
    watching: Callable[[str], AbstractContextManager[Watch | None]],
) -> tuple[list[EvaluatedRecording], list[str]]:
    """Reads each recording once; returns those that can be used, and why others cannot.

    Args:
        paths: Where they are.
        known: Recordings of an earlier session of the run.
        topics: Those of points, truth and odometry, see `choose_topics`; the same for all.
        watching: Makes of a name what watches how far the reading is, see `inspect_recording`.

    Raises:
        EvaluationError: The same recording is named twice, in whatever spelling.
        RecordingError: None of them can be used, or a topic of one is not there.
    """
    found, unreadable = [], []
    for path, name in zip(paths, recording_names(paths, known), strict=True):
        with watching(name) as watch:
            try:
                inspection = inspect_recording(path, watch)
            except RecordingError as error:
                unreadable.append(str(error))
                continue
        found.append(choose_topics(inspection, name, *topics))
    if not found:
        raise RecordingError("; ".join(unreadable))
    return found, unreadable


class _Traces(NamedTuple):
    """By what a recording is known again: its files, what is in them, and its short name."""

    files: list[Path]
    content: dict[str, Any] | None
    name: str


def recording_names(paths: Sequence[Path], known: Sequence[EvaluatedRecording] = ()) -> list[str]:
    """Returns a name for each recording: the last part of its path, or all of it if need be.

    Those known to a run keep their names, also where they have moved; others get one that is free.

    Raises:
        EvaluationError: The same recording is named twice, in whatever spelling.
    """
    traces = {path: _traces(path, with_content=bool(known)) for path in paths}
    _check_each_once(paths, traces)
    names = _known_names(traces, known)
    taken = {record.name for record in known}
    short = {path: traces[path].name for path in paths if path not in names}
    counts = Counter(chain(short.values(), taken))
    for path, name in short.items():
        names[path] = name if counts[name] == 1 else _free_name(path, taken)
        taken.add(names[path])
    return [names[path] for path in paths]


def _traces(path: Path, *, with_content: bool) -> _Traces:
    try:
        # Up to some megabytes of each file.
        content = fingerprint(path) if with_content else None
    except OSError:
        # Whoever reads it says why it cannot be read.
        content = {}
    return _Traces(storage_files(path), content, short_name(path))


def _check_each_once(paths: Sequence[Path], traces: Mapping[Path, _Traces]) -> None:
    owners: dict[Path, Path] = {}
    for path, times in Counter(paths).items():
        if times > 1:
            raise EvaluationError(f"{path}: is named {times} times")
        for file in traces[path].files:
            owner = owners.setdefault(file, path)
            if owner != path:
                raise EvaluationError(f"{path}: is the same recording as {owner}; name it once")


def _known_names(
    traces: Mapping[Path, _Traces], known: Sequence[EvaluatedRecording]
) -> dict[Path, str]:
    """The names of recordings that a run has already."""
    left = {
        one.name: _Traces(storage_files(Path(one.path)), one.fingerprint, one.name) for one in known
    }
    names: dict[Path, str] = {}
    # Copies may lie side by side, and another recording where one was before it moved. One that
    # is like none, but lies or is called as one, is for the record of the run to compare.
    for same in (
        lambda one: (one.files, one.content),
        lambda one: one.content,
        lambda one: one.files,
        lambda one: one.name,
    ):
        names_of = {repr(same(record)): name for name, record in left.items()}
        for path in (path for path in traces if path not in names and names_of):
            name = names_of.pop(repr(same(traces[path])), None)
            if name is not None:
                names[path] = name
                del left[name]
    return names


def short_name(path: Path) -> str:
    """Returns the last part of a path."""
    return path_text(path.stem if path.is_file() else path.resolve().name)


def _free_name(path: Path, taken: set[str]) -> str:
    whole = path_text(path.resolve())
    names = chain((path_text(path), whole), (f"{whole} ({number})" for number in count(2)))
    return next(name for name in names if name not in taken)
