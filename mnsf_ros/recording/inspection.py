"""What is in a recording and what is wrong with it, found out by reading all of it once."""

from __future__ import annotations

from collections import Counter
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_files import MCAP, ROS1, stored_files
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TopicSummary
from mnsf_ros.recording.damage import Damage, reason
from mnsf_ros.recording.salvage.salvage_reader import SalvageReader, salvaged_messages

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

_OTHER_PROFILE: Final = "Profile is not ros2"


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
            them are mcap, or a ROS 1 bag that has none. Else empty.
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
            yield stack.enter_context(SalvageReader(self.path, self.files, self.topics))


@dataclass(frozen=True)
class _FileContent:
    """What was found in one file: receive times of first and last message, and as in Inspection.

    Its index can be used if it is complete and the messages are stored in the order of time.
    """

    file: Path
    first_ns: float
    last_ns: float
    topics: dict[str, TopicSummary]
    damages: tuple[Damage, ...]
    has_checksums: bool
    is_regular: bool


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
    files = _plain_files(path, MCAP)
    problem: RecordingError | None = None
    topics: dict[str, TopicSummary] = {}
    try:
        with BagReader(path) as reader:
            topics = reader.topics
    except RecordingError as error:
        # Of a ROS 1 bag that cannot be opened, the index is damaged or was never written.
        files = files or _plain_files(path, ROS1)
        if not files:
            raise
        problem = error
    if not files:
        return Inspection(path, topics)
    contents = sorted(_contents(files, watch), key=lambda content: content.first_ns)
    inspection = _of_contents(path, contents, problem)
    if problem is None and not inspection.damages and inspection.topics != topics:
        # Its metadata.yaml knows better which of the files belong to the recording.
        return Inspection(path, topics)
    return inspection


def _plain_files(path: Path, suffix: str) -> list[Path]:
    """The files of the recording if all of them are of one kind."""
    try:
        files = stored_files(path)
        return files if all(f.suffix == suffix and f.is_file() for f in files) else []
    except OSError:
        return []


def _contents(files: Sequence[Path], watch: Callable[[int, int], None]) -> Iterator[_FileContent]:
    sizes = [file.stat().st_size for file in files]
    before = 0
    for file, size in zip(files, sizes, strict=True):
        yield _read_content(file, partial(_told, watch, before, sum(sizes)))
        before += size


def _told(watch: Callable[[int, int], None], before: int, total: int, offset: int) -> None:
    watch(before + offset, total)


def _read_content(file: Path, watch: Callable[[int], None]) -> _FileContent:
    """Reads a file from front to end, whatever its index says."""
    summary, messages = salvaged_messages(file)
    types = summary.types()
    counts: Counter[str] = Counter()
    damages: list[Damage] = []
    first_ns, last_ns = float("inf"), float("-inf")
    has_checksums, is_regular = True, summary.is_complete
    try:
        for message in messages:
            if isinstance(message, Damage):
                damages.append(message)
                continue
            watch(message.offset or 0)
            counts[message.topic] += 1
            types.setdefault(message.topic, message.msgtype)
            is_regular = is_regular and message.received_ns >= last_ns
            first_ns = min(first_ns, message.received_ns)
            last_ns = max(last_ns, message.received_ns)
            has_checksums = has_checksums and message.is_verified
    except OSError as error:
        damages.append(Damage(str(file), "", f"cannot be read: {reason(error)}"))
    if not damages:
        for topic, promised in (summary.counts or {}).items():
            if topic in types and counts[topic] != promised:
                text = f"{counts[topic]} of {promised} messages on {topic!r} were found"
                damages.append(Damage(str(file), "", text))
    topics = {topic: TopicSummary(types[topic], counts[topic]) for topic in sorted(types)}
    return _FileContent(file, first_ns, last_ns, topics, tuple(damages), has_checksums, is_regular)


def _of_contents(
    path: Path, contents: Sequence[_FileContent], problem: RecordingError | None
) -> Inspection:
    topics: dict[str, TopicSummary] = {}
    for content in contents:
        for topic, summary in content.topics.items():
            known = topics.get(topic, TopicSummary(summary.msgtype, 0))
            topics[topic] = TopicSummary(known.msgtype, known.count + summary.count)
    if not any(summary.count for summary in topics.values()):
        raise problem or RecordingError(f"{path}: holds no messages that can be read")
    damages = [damage for content in contents for damage in content.damages]
    if problem is not None and not damages and _OTHER_PROFILE not in str(problem):
        damages = [Damage(str(path), "", str(problem).removeprefix(f"{path}: "))]
    # rosbags sorts by receive time. Where the clock of the recorder jumped back, that would mix
    # sweeps from before and after the jump.
    is_regular = all(content.is_regular for content in contents) and all(
        former.last_ns <= latter.first_ns for former, latter in pairwise(contents)
    )
    return Inspection(
        path=path,
        topics=dict(sorted(topics.items())),
        damages=tuple(damages),
        has_checksums=all(content.has_checksums for content in contents),
        files=tuple(content.file for content in contents),
        needs_salvage=problem is not None or bool(damages) or not is_regular,
    )
