# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The recordings of a run: names, topics and identity."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from mnsf_ros.errors import EvaluationError, RecordingError, plain_text
from mnsf_ros.recording.bag_files import fingerprint
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import UsedTopics, used_topics
from mnsf_ros.setting import SettingValue


@dataclass(frozen=True)
class EvaluatedRecording:
    """A recording and the topics that are used of it."""

    name: str  # in results
    path: str
    points: str  # topic of the sweeps
    truth: str | None  # topic of the true flow
    odometry: str | None  # topic of the sensor's poses
    num_sweeps: int  # that are stored
    damages: list[str]  # unreadable parts
    fingerprint: dict[str, SettingValue]  # see `recording.bag_files`

    @property
    def topics(self) -> UsedTopics:
        """The topics that are used."""
        return UsedTopics(self.points, self.truth, self.odometry)

    @property
    def identity(self) -> dict[str, object]:
        """Everything that must not change during a run, by name; the path may."""
        values = vars(self.topics) | {"num_sweeps": self.num_sweeps}
        return values | {f"fingerprint: {name}": value for name, value in self.fingerprint.items()}


def choose_topics(
    path: Path | str, name: str, points: str | None = None, odometry: str | None = None
) -> EvaluatedRecording:
    """Returns a recording with its topics: those named, the others as `used_topics`.

    Raises:
        RecordingError: The recording cannot be read, or as `used_topics`.
    """
    with BagReader(path) as reader:
        used = used_topics(reader.path, reader.topics, points, odometry)
        return EvaluatedRecording(
            name=name,
            path=str(reader.path.resolve()),
            **vars(used),
            num_sweeps=reader.topics[used.points].count,
            damages=[plain_text(damage) for damage in reader.damages],
            fingerprint=fingerprint(reader.path),
        )


def chosen_recordings(
    paths: Sequence[Path], *topics: str | None, unreadable: list[str] | None = None
) -> list[EvaluatedRecording]:
    """Returns recordings with unique names and their topics, see `choose_topics`.

    The errors of those that cannot be used are added to the list `unreadable`, if there is one.

    Raises:
        EvaluationError: The same recording is named twice.
        RecordingError: A recording cannot be used; with a list: none can.
    """
    found: list[EvaluatedRecording] = []
    for name, path in named_recordings(paths):
        try:
            found.append(choose_topics(path, name, *topics))
        except RecordingError as error:
            if unreadable is None or (path == paths[-1] and not found):
                raise RecordingError("; ".join([*(unreadable or []), str(error)])) from error
            unreadable.append(str(error))
    return found


def named_recordings(paths: Sequence[Path]) -> list[tuple[str, Path]]:
    """Returns each path with a unique name: its last part if possible, else all of it.

    Raises:
        EvaluationError: The same recording is named twice.
    """
    names, places = [short_name(path) for path in paths], [path.resolve() for path in paths]
    for path, place in zip(paths, places, strict=True):
        if places.count(place) > 1:
            raise EvaluationError(f"{path}: is the same recording as another one; name it once")
    return [
        (name if names.count(name) == 1 else plain_text(path), path)
        for name, path in zip(names, paths, strict=True)
    ]


def short_name(path: Path) -> str:
    """Returns the last part of a path, without the suffix of a file."""
    return plain_text(path.stem if path.is_file() else path.resolve().name)
