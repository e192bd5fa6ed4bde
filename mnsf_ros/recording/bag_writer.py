# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Writing recordings as rosbag2 folders in mcap format, all or nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import ExitStack, contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, Final

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from numpy.typing import NDArray
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_files import (
    MCAP,
    METADATA_NAME,
    SUFFIXES,
    WrittenTopic,
    write_metadata,
)
from mnsf_ros.recording.bag_messages import cloud_message, odometry_message
from mnsf_ros.recording.bag_topics import (
    CLOUD_TYPE,
    ODOMETRY_FRAME,
    ODOMETRY_TYPE,
    POINTS_TOPIC,
    TRUTH_FLOW_TOPIC,
    TRUTH_ODOMETRY_TOPIC,
)
from mnsf_ros.recording.damage import reason
from mnsf_ros.recording.flow_truth import FlowTruth
from msg_utils.cloud_layout import EncodedCloud
from msg_utils.errors import MessageError
from msg_utils.point_cloud2 import encode_columns

_LATEST_NS: Final = 2**63 - 1
_REPLACEABLE_SUFFIXES: Final = (*SUFFIXES, ".zstd")


class BagWriter:
    """Writer of a recording; use it as a context manager.

    A folder, or a single file if the path ends in `.mcap`, appears when the block ends well. After
    any exception in the block, also KeyboardInterrupt, nothing is left behind. The receive time of
    every message is the stamp it is written with. Every part of the file has a checksum.

    Attributes:
        path: The folder or file to write.
    """

    def __init__(
        self, path: Path | str, *, overwrite: bool = False, compress: bool = False
    ) -> None:
        """Sets the target; nothing is written before `with`, which makes missing parents.

        A recording at the same path is replaced only if `overwrite` is set. With `compress` chunks
        of the file are compressed with zstd: smaller but slower.
        """
        self.path = Path(path)
        self._overwrite = overwrite
        self._compression = CompressionType.ZSTD if compress else CompressionType.NONE
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._topics: dict[str, WrittenTopic] = {}
        self._first_ns, self._end_ns = _LATEST_NS, 0
        self._file = self.path
        self._writer: McapWriter | None = None
        self._stack = ExitStack()

    def __enter__(self) -> BagWriter:
        """Opens a draft beside the path.

        Raises:
            RecordingError: The path exists already, or nothing can be written there.
        """
        with self._guarded(), ExitStack() as stack:
            draft = stack.enter_context(new_folder(self.path, overwrite=self._overwrite))
            draft.mkdir()
            self._file = draft / f"{draft.name}.mcap"
            stream = stack.enter_context(self._file.open("wb"))
            self._writer = McapWriter(stream, compression=self._compression)
            self._writer.start(profile="ros2")
            stack.push(self._finish)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:  # noqa: ANN401
        """Moves the finished recording to its path, or removes it after an exception.

        Raises:
            RecordingError: Nothing was written, or the recording cannot be finished.
        """
        with self._guarded():
            self._stack.__exit__(*error)

    def write_raw(
        self, topic: str, msgtype: str, stamp_ns: int, raw: bytes | bytearray | memoryview
    ) -> None:
        """Adds a message as CDR bytes; the first on a topic fixes its type, one of ROS 2 Jazzy.

        Raises:
            RecordingError: The type is unknown or not the topic's, or writing fails.
        """
        if self._writer is None:
            raise RecordingError(f"{self.path}: is not open for writing")
        if not 0 <= stamp_ns <= _LATEST_NS:
            raise RecordingError(
                f"{self.path}: cannot write stamp {stamp_ns} ns, expected 0 to {_LATEST_NS}"
            )
        with self._guarded():
            written = self._topic(self._writer, topic, msgtype)
            self._writer.add_message(written.channel, stamp_ns, bytes(raw), stamp_ns)
        written.count += 1
        self._first_ns = min(self._first_ns, stamp_ns)
        self._end_ns = max(self._end_ns, stamp_ns)

    def write_cloud(
        self,
        topic: str,
        cloud: EncodedCloud,
        stamp_ns: int,
        frame_id: str,
        *,
        is_dense: bool = True,
    ) -> None:
        """Adds a point cloud; its header stamp is the receive time, too.

        Raises:
            RecordingError: The stamp does not fit a ROS message, or writing fails.
        """
        with self._guarded():
            message = cloud_message(cloud, stamp_ns, frame_id, is_dense=is_dense)
        self._write(topic, CLOUD_TYPE, stamp_ns, message)

    def write_sweep(
        self,
        xyz: NDArray[np.float32],
        columns: Mapping[str, NDArray[Any]],
        truth: FlowTruth,
        pose: NDArray[np.floating[Any]] | None,
        frame_id: str,
    ) -> None:
        """Adds a sweep on the usual topics: points (N, 3) with more columns (N,), truth and pose.

        Raises:
            RecordingError: The numbers of points differ, or writing fails.
        """
        stamp_ns, axes = truth.stamp_ns, {name: xyz[:, axis] for axis, name in enumerate("xyz")}
        points = encode_columns({**axes, **columns}, 1, len(xyz))
        is_dense = bool(np.isfinite(xyz).all())
        is_known = is_dense and bool(truth.valid.all())
        self.write_cloud(POINTS_TOPIC, points, stamp_ns, frame_id, is_dense=is_dense)
        flow = truth.encode(xyz)
        self.write_cloud(TRUTH_FLOW_TOPIC, flow, stamp_ns, frame_id, is_dense=is_known)
        if pose is not None:
            self.write_odometry(TRUTH_ODOMETRY_TOPIC, pose, stamp_ns, ODOMETRY_FRAME, frame_id)

    def write_odometry(
        self,
        topic: str,
        pose: NDArray[np.floating[Any]],
        stamp_ns: int,
        frame_id: str,
        child_frame_id: str,
    ) -> None:
        """Adds the (4, 4) pose, metres, of the child frame in `frame_id`; the velocity is zero.

        Raises:
            RecordingError: The stamp does not fit a ROS message, or writing fails.
        """
        with self._guarded():
            message = odometry_message(pose, stamp_ns, frame_id, child_frame_id)
        self._write(topic, ODOMETRY_TYPE, stamp_ns, message)

    def _write(self, topic: str, msgtype: str, stamp_ns: int, message: object) -> None:
        self.write_raw(topic, msgtype, stamp_ns, self._typestore.serialize_cdr(message, msgtype))

    def _topic(self, writer: McapWriter, name: str, msgtype: str) -> WrittenTopic:
        known = self._topics.get(name)
        if known is not None and known.msgtype == msgtype:
            return known
        if known is not None:
            raise RecordingError(
                f"{self.path}: topic {name!r} holds {known.msgtype}, cannot add {msgtype}"
            )
        if msgtype not in self._typestore.types:
            raise RecordingError(f"{self.path}: {msgtype!r} is not a message type of ROS 2 Jazzy")
        definition, _ = self._typestore.generate_msgdef(msgtype, ros_version=2)
        schema = writer.register_schema(msgtype, "ros2msg", definition.encode())
        channel = writer.register_channel(name, "cdr", schema, {"offered_qos_profiles": ""})
        type_hash = self._typestore.hash_rihs01(msgtype)
        self._topics[name] = WrittenTopic(name, msgtype, type_hash, channel)
        return self._topics[name]

    def _finish(self, kind: type[BaseException] | None, *_: object) -> None:
        writer, self._writer = self._writer, None
        if kind is not None or writer is None:
            return
        if not self._topics:
            raise RecordingError(f"{self.path}: nothing was written, so there is no recording")
        writer.finish()  # type: ignore[no-untyped-call]
        write_metadata(self._file, self._topics.values(), self._first_ns, self._end_ns)

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except (OSError, MessageError) as error:
            raise RecordingError(f"{self.path}: cannot be written: {reason(error)}") from error


@contextmanager
def new_folder(path: Path, *, overwrite: bool = False) -> Iterator[Path]:
    """Draft of a recording; moved to `path` when the block ends well, else removed.

    Missing parents are made. If the path ends in `.mcap`, only the mcap file in the folder is moved
    there. With `overwrite` a recording that is there already is replaced, at the very end.

    Raises:
        RecordingError: Something is there already that may not be replaced.
        OSError: The folder cannot be made or moved.
    """
    check_target(path, overwrite=overwrite)
    path.parent.mkdir(parents=True, exist_ok=True)
    is_file, prefix = path.suffix == MCAP, f".{path.name}."
    with TemporaryDirectory(prefix=prefix, suffix=".partial", dir=path.parent) as temporary:
        draft = Path(temporary, path.stem if is_file else path.name)
        yield draft
        if is_file:
            (draft,) = draft.glob(f"*{MCAP}")
        check_target(path, overwrite=overwrite)
        replaced = Path(temporary, f"{path.name}.replaced")
        if path.exists():
            path.rename(replaced)
        try:
            draft.rename(path)
        except BaseException:
            if replaced.exists():
                replaced.rename(path)
            raise


def check_target(path: Path, *, overwrite: bool) -> None:
    """Checks the target of a recording before any work is done.

    Raises:
        RecordingError: Something is there already that may not be replaced.
    """
    if not path.name:
        raise RecordingError(f"{str(path)!r}: is not the name of a folder, expected one to write")
    if path.suffix == MCAP and path.is_dir():
        raise RecordingError(f"{path}: is a folder, expected a file")
    if path.suffix in SUFFIXES and path.suffix != MCAP:
        raise RecordingError(f"{path}: a recording is a folder: leave out {path.suffix!r}")
    if not path.exists() and not path.is_symlink():
        return
    if not overwrite:
        raise RecordingError(f"{path}: exists already; --force replaces it")
    if path.suffix == MCAP:
        return
    # A wrong path must not cost anybody their other files.
    others = [path.name] if not path.is_dir() or path.is_symlink() else _other_files(path)
    if others:
        raise RecordingError(f"{path}: is not replaced: not a recording, or it holds {others[0]!r}")


def _other_files(folder: Path) -> list[str]:
    return sorted(
        entry.name
        for entry in folder.iterdir()
        if not entry.is_file()
        or (entry.name != METADATA_NAME and entry.suffix not in _REPLACEABLE_SUFFIXES)
    )
