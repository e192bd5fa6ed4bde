# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What reading a recording once has shown, and how far the reading is."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence


@dataclass(frozen=True)
class Inspection:
    """What reading a recording once has shown; small, and may be sent to other processes.

    Attributes:
        path: The recording.
        topics: Topic -> type and number of messages that can be read.
        damages: What cannot be read. Of recordings without `files` only what opening them shows;
            `BagReader.readable_messages` finds the rest.
        has_checksums: Whether flipped bits in messages would have been noticed.
        files: The files in the order of time, if they can be read without their index: all of
            them are mcap, or ROS 1 bags. Else empty.
        needs_salvage: Whether `files` have to be read so: they are damaged, have no index, or hold
            messages that are not in the order of their receive times.
    """

    path: Path
    topics: dict[str, TopicSummary]
    damages: tuple[Damage, ...] = ()
    has_checksums: bool = False
    files: tuple[Path, ...] = ()
    needs_salvage: bool = False

    @contextmanager
    def open(self) -> Iterator[BagReader]:
        """Opens the recording.

        Raises:
            RecordingError: It has changed since it was inspected.
        """
        with ExitStack() as stack:
            if not self.needs_salvage:
                try:
                    reader = stack.enter_context(BagReader(self.path))
                except RecordingError:
                    if not self.files:
                        raise
                else:
                    yield reader
                    return
            from mnsf_ros.recording.salvage.salvage_reader import SalvageReader

            yield stack.enter_context(SalvageReader(self.path, self.files, self.topics))


class Progress:
    """Tells how many bytes of some files have been read; does nothing unless it is watched."""

    def __init__(
        self, files: Sequence[Path], watch: Callable[[int, int], None] | None = None
    ) -> None:
        """Calls `watch` with the number of bytes read and that of all."""
        self._sizes = {file: file.stat().st_size for file in files}
        self._begins: dict[Path, int] = {}
        self._watch = watch

    def read(self, file: Path, offset: int) -> None:
        """Tells that a file is read up to a place, all files before it to their end."""
        if self._watch is not None:
            before = self._begins.setdefault(file, sum(self._sizes[one] for one in self._begins))
            self._watch(before + offset, sum(self._sizes.values()))
