"""Writing recordings as rosbag2 folders in mcap format, all or nothing."""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer, WriterError
from rosbags.typesys import Stores, get_typestore

from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_errors import reason
from mnsf_ros.recording.bag_messages import cloud_message, odometry_message
from mnsf_ros.recording.conventions import CLOUD_TYPE, ODOMETRY_TYPE
from mnsf_ros.recording.mcap_checksums import checksums_added
from mnsf_ros.recording.new_folder import new_folder
from msg_utils.errors import MessageError

if TYPE_CHECKING:
    from collections.abc import Iterator
    from types import TracebackType

    import numpy as np
    from numpy.typing import NDArray
    from rosbags.interfaces import Connection

    from msg_utils.point_cloud2 import EncodedCloud

_LATEST_NS: Final = 2**63 - 1


class BagWriter:
    """A recording being written; use it as a context manager.

    The folder appears at its path when the block ends well. After any exception in the block,
    also KeyboardInterrupt, nothing is left behind. The receive time of every message is the
    stamp it is written with.

    Attributes:
        path: The folder to write.
    """

    def __init__(
        self, path: Path | str, *, overwrite: bool = False, compress: bool = False
    ) -> None:
        """Name the recording; nothing is written before `with`.

        Args:
            path: Folder to write; its missing parents are made.
            overwrite: Whether a recording at the same path may be replaced.
            compress: Whether to compress chunks of the file with zstd: smaller but slower.
        """
        self.path = Path(path)
        self._overwrite = overwrite
        self._compress = compress
        self._typestore = get_typestore(Stores.ROS2_JAZZY)
        self._connections: dict[str, Connection] = {}
        self._writer: Writer | None = None
        self._stack = ExitStack()
        self._is_empty = True

    def __enter__(self) -> BagWriter:
        """Start to write beside the path.

        Raises:
            RecordingError: The path exists already, or nothing can be written there.
        """
        with self._guarded(), ExitStack() as stack:
            draft = stack.enter_context(new_folder(self.path, overwrite=self._overwrite))
            stack.enter_context(checksums_added(draft))
            writer = Writer(draft, version=9, storage_plugin=StoragePlugin.MCAP)
            if self._compress:
                writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
            self._writer = stack.enter_context(writer)
            stack.push(self._refuse_empty)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Move the finished recording to its path, or remove it after an exception.

        Raises:
            RecordingError: Nothing was written, or the recording cannot be finished.
        """
        self._writer = None
        with self._guarded():
            self._stack.__exit__(kind, error, trace)

    def write_raw(
        self, topic: str, msgtype: str, stamp_ns: int, raw: bytes | bytearray | memoryview
    ) -> None:
        """Add a serialized message.

        Args:
            topic: Topic name; the first message on a topic fixes its type.
            msgtype: A type of ROS 2 Jazzy, for example `sensor_msgs/msg/PointCloud2`.
            stamp_ns: Receive time in nanoseconds.
            raw: CDR bytes as they go over the wire.

        Raises:
            RecordingError: The type is unknown or not the topic's, or writing fails.
        """
        if self._writer is None:
            raise RecordingError(f"{self.path}: is not open for writing")
        if not 0 <= stamp_ns <= _LATEST_NS:
            raise RecordingError(f"{self.path}: stamp {stamp_ns} ns is no time, cannot write it")
        connection = self._connection(self._writer, topic, msgtype)
        with self._guarded():
            self._writer.write(connection, stamp_ns, memoryview(raw))
        self._is_empty = False

    def write_cloud(
        self,
        topic: str,
        cloud: EncodedCloud,
        stamp_ns: int,
        frame_id: str,
        *,
        is_dense: bool = True,
    ) -> None:
        """Add a point cloud.

        Args:
            topic: Topic name.
            cloud: Layout and data.
            stamp_ns: Header stamp and receive time in nanoseconds.
            frame_id: Frame of the coordinates.
            is_dense: Whether all points are finite.

        Raises:
            RecordingError: The stamp does not fit a ROS message, or writing fails.
        """
        with self._guarded():
            message = cloud_message(cloud, stamp_ns, frame_id, is_dense=is_dense)
        self._write(topic, CLOUD_TYPE, stamp_ns, message)

    def write_odometry(
        self,
        topic: str,
        pose: NDArray[np.floating[Any]],
        stamp_ns: int,
        frame_id: str,
        child_frame_id: str,
    ) -> None:
        """Add a pose; the velocity in the message stays zero.

        Args:
            topic: Topic name.
            pose: (4, 4) pose of the child frame in the frame `frame_id`, in meters.
            stamp_ns: Header stamp and receive time in nanoseconds.
            frame_id: The fixed frame.
            child_frame_id: The moving frame.

        Raises:
            RecordingError: The stamp does not fit a ROS message, or writing fails.
        """
        with self._guarded():
            message = odometry_message(pose, stamp_ns, frame_id, child_frame_id)
        self._write(topic, ODOMETRY_TYPE, stamp_ns, message)

    def _write(self, topic: str, msgtype: str, stamp_ns: int, message: object) -> None:
        self.write_raw(topic, msgtype, stamp_ns, self._typestore.serialize_cdr(message, msgtype))

    def _connection(self, writer: Writer, topic: str, msgtype: str) -> Connection:
        known = self._connections.get(topic)
        if known is not None and known.msgtype == msgtype:
            return known
        if known is not None:
            raise RecordingError(
                f"{self.path}: topic {topic!r} holds {known.msgtype}, cannot add {msgtype}"
            )
        if msgtype not in self._typestore.types:
            raise RecordingError(f"{self.path}: {msgtype!r} is no type of ROS 2 Jazzy")
        with self._guarded():
            connection = writer.add_connection(topic, msgtype, typestore=self._typestore)
        self._connections[topic] = connection
        return connection

    def _refuse_empty(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is None and self._is_empty:
            raise RecordingError(f"{self.path}: nothing was written, so there is no recording")

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except (OSError, WriterError, MessageError) as error:
            raise RecordingError(f"{self.path}: cannot be written: {reason(error)}") from error
