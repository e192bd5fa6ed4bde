"""What is in a recording and what is wrong with it, found out by reading all of it once."""

from __future__ import annotations

from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_files import SUFFIXES
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.damage import Damage
from mnsf_ros.recording.file_content import FileContent, read_content
from mnsf_ros.recording.sequential_reader import SequentialReader

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

    from mnsf_ros.recording.bag_topics import TopicSummary

_MCAP: Final = ".mcap"
_ROS1: Final = ".bag"
_OTHER_PROFILE: Final = "Profile is not ros2"


@dataclass(frozen=True)
class Inspection:
    """What reading a recording once has shown; small, and may be sent to other processes.

    Attributes:
        path: The recording.
        topics: Topic -> type and number of messages that can be read.
        damages: What cannot be read. Of recordings without `files` only what opening them shows;
            `readable_messages` finds the rest.
        has_checksums: Whether flipped bits in messages would have been noticed.
        files: The files in the order of time, if they are read without their index: all of them
            are mcap, or a ROS 1 bag that has none. Else empty.
    """

    path: Path
    topics: dict[str, TopicSummary]
    damages: tuple[Damage, ...] = ()
    has_checksums: bool = False
    files: tuple[Path, ...] = ()

    @contextmanager
    def open(self) -> Iterator[BagReader]:
        """Opens the recording.

        Raises:
            RecordingError: It has changed since it was inspected.
        """
        reader = BagReader(self.path)
        if self.files:
            reader = SequentialReader(self.path, self.files, self.topics)
        with reader:
            yield reader


def _nobody(done: int, total: int) -> None:
    pass


def inspect_recording(path: Path | str, watch: Callable[[int, int], None] = _nobody) -> Inspection:
    """Reads a recording once and says what can be used of it.

    Args:
        path: A rosbag2 folder, or a .mcap, .db3 or .bag file.
        watch: Called with the number of bytes read and that of all, again and again.

    Raises:
        RecordingError: There is none, or no message of it can be read.
    """
    path = Path(path)
    files = _mcap_files(path)
    problem: RecordingError | None = None
    topics: dict[str, TopicSummary] = {}
    try:
        with BagReader(path) as reader:
            topics = reader.topics
    except RecordingError as error:
        # Of a ROS 1 bag that cannot be opened, the index is damaged or was never written.
        files = files or _ros1_files(path)
        if not files:
            raise
        problem = error
    if not files:
        return Inspection(path, topics)
    inspection = _of_content(path, _contents(files, watch), problem)
    if problem is None and not inspection.damages and inspection.topics != topics:
        # Its metadata.yaml knows better which of the files belong to the recording.
        return Inspection(path, topics)
    return inspection


def _contents(files: Sequence[Path], watch: Callable[[int, int], None]) -> list[FileContent]:
    sizes = [file.stat().st_size for file in files]
    total, before, contents = sum(sizes), 0, []
    for file, size in zip(files, sizes, strict=True):
        contents.append(read_content(file, partial(_told, watch, before, total)))
        before += size
    return contents


def _told(watch: Callable[[int, int], None], before: int, total: int, offset: int) -> None:
    watch(before + offset, total)


def _of_content(
    path: Path, contents: Sequence[FileContent], problem: RecordingError | None
) -> Inspection:
    contents = sorted(contents, key=lambda content: content.first_ns)
    topics = FileContent.merged_topics(contents)
    if not any(summary.count for summary in topics.values()):
        raise problem or RecordingError(f"{path}: holds no messages that can be read")
    damages = [damage for content in contents for damage in content.damages]
    if problem is not None and not damages and _OTHER_PROFILE not in str(problem):
        damages = [Damage(str(path), "", str(problem).removeprefix(f"{path}: "))]
    return Inspection(
        path=path,
        topics=topics,
        damages=tuple(damages),
        has_checksums=all(content.has_checksums for content in contents),
        files=tuple(content.file for content in contents),
    )


def _ros1_files(path: Path) -> list[Path]:
    return [path] if path.suffix == _ROS1 and path.is_file() else []


def _mcap_files(path: Path) -> list[Path]:
    """The files of the recording if all of them are plain mcap."""
    if path.is_file():
        return [path] if path.suffix == _MCAP else []
    if not path.is_dir():
        return []
    stored = [file for file in sorted(path.iterdir()) if file.suffix in (*SUFFIXES, ".zstd")]
    is_plain = all(file.suffix == _MCAP and file.is_file() for file in stored)
    return stored if is_plain else []
