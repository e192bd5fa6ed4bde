# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The recordings of a run: names, topics and identity."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from pathlib import Path

from mnsf_ros.errors import EvaluationError, RecordingError
from mnsf_ros.recording.bag_files import fingerprint, storage_files
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import used_topics
from mnsf_ros.recording.inspection import Inspection, inspect_recording
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
        name: Its name in results.
        path: Its path.
        points: Topic of the sweeps.
        truth: Topic of the true flow; None if there is none.
        odometry: Topic of the sensor's poses; None if there is none.
        num_sweeps: Number of sweeps that are stored.
        has_checksums: Whether flipped bits within a message would have been noticed.
        damages: Unreadable parts.
        fingerprint: See `recording.bag_files`.
        inspection: Result of reading it once; None in the record of an earlier run.
    """

    name: str
    path: str
    points: str
    truth: str | None
    odometry: str | None
    num_sweeps: int
    has_checksums: bool
    damages: list[str]
    fingerprint: dict[str, SettingValue]
    inspection: Inspection | None = None

    @property
    def identity(self) -> dict[str, object]:
        """Name to value of all that must not change while a run lasts; the path may."""
        told = {name: getattr(self, name) for name in ("points", "truth", "odometry", "num_sweeps")}
        return told | {f"fingerprint: {name}": value for name, value in self.fingerprint.items()}

    @contextmanager
    def open(self) -> Iterator[BagReader]:
        """Opens the recording.

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
    """Returns a recording with its topics.

    Topics that are None are chosen: the only topic of point clouds; truth and odometry as in
    `docs/recordings.md`, if they are there.

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
    *topics: str | None,
    watching: Callable[[str], AbstractContextManager[Watch | None]],
) -> tuple[list[EvaluatedRecording], list[str]]:
    """Reads each recording once; returns the usable ones, and an error text for each other one.

    Args:
        paths: Where they are.
        topics: Those of points, truth and odometry, see `choose_topics`; the same for all.
        watching: Name of a recording to a context with the progress of reading, see
            `inspect_recording`.

    Raises:
        EvaluationError: The same recording is named twice, in whatever spelling.
        RecordingError: None of them can be used, or a topic of one is not there.
    """
    found, unreadable = [], []
    for path, name in zip(paths, recording_names(paths), strict=True):
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


def recording_names(paths: Sequence[Path]) -> list[str]:
    """Returns a name for each recording: the last part of its path, or all of it if need be.

    Raises:
        EvaluationError: The same recording is named twice, in whatever spelling.
    """
    owners: dict[Path, Path] = {}
    for path in paths:
        for file in storage_files(path):
            if file in owners:
                raise EvaluationError(
                    f"{path}: is the same recording as {owners[file]}; name it once"
                )
            owners[file] = path
    names = [short_name(path) for path in paths]
    return [
        name if names.count(name) == 1 else path_text(path)
        for name, path in zip(names, paths, strict=True)
    ]


def short_name(path: Path) -> str:
    """Returns the last part of a path, without the suffix of a file."""
    return path_text(path.stem if path.is_file() else path.resolve().name)
