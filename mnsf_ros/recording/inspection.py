# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Content and damage of a recording, as far as opening it shows."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mnsf_ros.recording.bag_reader import BagReader, Watch
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage

_MAX_WARNINGS: Final = 5


@dataclass(frozen=True)
class Inspection:
    """Content of a recording; small, and may be sent to other processes.

    The attributes are those of a `BagReader`.
    """

    path: Path
    topics: dict[str, TopicSummary]
    damages: tuple[Damage, ...] = ()
    has_checksums: bool = False

    def open(self) -> BagReader:
        """Returns a reader of the recording."""
        return BagReader(self.path)


def inspect_recording(path: Path | str, watch: Watch | None = None) -> Inspection:
    """Opens a recording to tell its content.

    Args:
        path: A rosbag2 folder, or a .mcap, .db3 or .bag file.
        watch: See `BagReader`.

    Raises:
        RecordingError: There is none, or nothing of it can be read.
    """
    with BagReader(path, watch) as reader:
        return Inspection(reader.path, reader.topics, reader.damages, reader.has_checksums)


@contextmanager
def open_recording(path: Path | str, warn: Callable[[str], None]) -> Iterator[BagReader]:
    """Opens a recording and warns of its damage, in a few lines.

    Raises:
        RecordingError: There is none, or nothing of it can be read.
    """
    with BagReader(path) as reader:
        for damage in reader.damages[:_MAX_WARNINGS]:
            warn(str(damage))
        if (more := len(reader.damages) - _MAX_WARNINGS) > 0:
            warn(f"{path}: and {more} more")
        yield reader
