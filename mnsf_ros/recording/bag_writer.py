# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Writing recordings as rosbag2 folders in mcap format, all or nothing."""

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any, Final

import numpy as np
from mcap.writer import CompressionType
from mcap.writer import Writer as McapWriter
from rosbags.interfaces import Connection
from rosbags.rosbag2 import CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as RosbagsWriter

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.ego_motion.covariance import UNKNOWN_COVARIANCE
from mnsf_ros.errors import UNREADABLE, RecordingError, reason
from mnsf_ros.geometry.transforms import pose_quaternion
from mnsf_ros.recording.bag_files import new_folder
from mnsf_ros.recording.bag_topics import (
    ODOMETRY_FRAME,
    POINTS_TOPIC,
    TF_TOPIC,
    TRUTH_FLOW_TOPIC,
    TRUTH_ODOMETRY_TOPIC,
    jazzy,
)
from mnsf_ros.recording.flow_truth import TrueSweep
from mnsf_ros.recording.messages import Messages
from mnsf_ros.sweeps_io.flow_columns import object_columns
from mnsf_ros.sweeps_io.object_markers import objects_markers
from msg_utils.cdr import serialized_cloud
from msg_utils.cloud_layout import EncodedCloud
from msg_utils.errors import checked_integer
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import encode_columns
from msg_utils.stamps import encode_stamp

_LATEST_NS: Final = 2**63 - 1


class _CheckedMcap:
    """An mcap file for the writer of rosbags; its own has no checksums."""

    def __init__(self, folder: Path, _compression: CompressionMode) -> None:
        self.path = folder / f"{folder.name}.mcap"
        self._stream = self.path.open("xb")
        # mcap 1.6.0 gives offsets of groups that it does not write; `pymcap-cli doctor` objects.
        self._writer = McapWriter(
            self._stream, compression=CompressionType.ZSTD, use_summary_offsets=False
        )
        self._writer.start(profile="ros2")
        self._schemas: dict[str, int] = {}
        self._channels: dict[int, int] = {}
        self._num_written: Counter[int] = Counter()

    def add_msgtype(self, connection: Connection) -> None:
        definition = connection.msgdef.data.encode()
        schema = self._writer.register_schema(connection.msgtype, "ros2msg", definition)
        self._schemas[connection.msgtype] = schema

    def add_connection(self, connection: Connection, _profiles: str) -> None:
        schema, about = self._schemas[connection.msgtype], {"offered_qos_profiles": ""}
        channel = self._writer.register_channel(connection.topic, "cdr", schema, about)
        self._channels[connection.id] = channel

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None:
        number = self._channels[connection.id]
        self._num_written[number] += 1
        sequence = self._num_written[number] % 2**32
        self._writer.add_message(number, timestamp, bytes(data), timestamp, sequence)

    def close(self, _version: int, _metadata: str) -> None:
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._stream.close()

    def abort(self) -> None:
        self._stream.close()


class BagWriter:
    """Writer of a recording; use it as a context manager.

    A folder, or a single file if the path ends in `.mcap`, appears when the block ends well. After
    any exception in the block, also KeyboardInterrupt, nothing is left behind. The receive time of
    every message is the stamp it is written with. Every part of the file has a checksum.

    Raises:
        RecordingError: From `with` and from each method: the path exists already and is not to be
            overwritten, a message does not fit (type, stamp, pose), nothing was written, or writing
            fails.
    """

    def __init__(self, path: Path | str, *, overwrite: bool = False) -> None:
        self.path = Path(path)
        self._overwrite = overwrite
        self._connections: dict[str, Connection] = {}
        self._writer: RosbagsWriter | None = None
        self._stack = ExitStack()

    def __enter__(self) -> "BagWriter":
        """Opens a draft beside the path."""
        with self._guarded(), ExitStack() as stack:
            draft = stack.enter_context(new_folder(self.path, overwrite=self._overwrite))
            writer = RosbagsWriter(draft, version=9, storage_plugin=StoragePlugin.MCAP)
            writer.STORAGE_PLUGINS = {StoragePlugin.MCAP: _CheckedMcap}
            self._writer = stack.enter_context(writer)
            stack.push(self._finish)
            self._stack = stack.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:  # noqa: ANN401
        """Moves the finished recording to its path, or removes it after an exception."""
        with self._guarded():
            self._stack.__exit__(*error)

    def write_raw(
        self, topic: str, msgtype: str, stamp_ns: int, raw: bytes | bytearray | memoryview
    ) -> None:
        """Adds a message as CDR bytes; the first on a topic fixes its type, one of ROS 2 Jazzy."""
        if self._writer is None:
            raise RecordingError(f"{self.path}: is not open for writing")
        with self._guarded():
            connection = self._connections.get(topic)
            if connection is None:
                connection = self._writer.add_connection(topic, msgtype, typestore=jazzy())
                self._connections[topic] = connection
            if connection.msgtype != msgtype:
                raise ValueError(f"topic {topic!r} holds {connection.msgtype}, got {msgtype}")
            checked_integer(stamp_ns, "stamp", _LATEST_NS)
            self._writer.write(connection, stamp_ns, bytes(raw))

    def write_message(self, topic: str, message: Any, stamp_ns: int) -> None:  # noqa: ANN401
        """Adds one of the `Messages` of ROS 2 Jazzy."""
        msgtype = message.__msgtype__
        with self._guarded():
            raw = jazzy().serialize_cdr(message, msgtype)
        self.write_raw(topic, msgtype, stamp_ns, raw)

    def write_cloud(
        self,
        topic: str,
        cloud: EncodedCloud,
        stamp_ns: int,
        frame_id: str,
        *,
        is_dense: bool = True,
    ) -> None:
        """Adds a point cloud."""
        with self._guarded():
            raw = serialized_cloud(_header(stamp_ns, frame_id), cloud, is_dense=is_dense)
        self.write_raw(topic, CLOUD_TYPE, stamp_ns, raw)

    def write_sweep(self, sweep: TrueSweep, frame_id: str) -> None:
        """Adds a sweep on the usual topics, with its truth and its pose."""
        xyz, truth = sweep.xyz, sweep.truth
        axes = {name: xyz[:, axis] for axis, name in enumerate("xyz")}
        points = encode_columns({**axes, **sweep.columns}, 1, len(xyz))
        is_dense = bool(np.isfinite(xyz).all())
        is_known = is_dense and bool(truth.valid.all())
        self.write_cloud(POINTS_TOPIC, points, truth.stamp_ns, frame_id, is_dense=is_dense)
        flow = truth.encode(xyz)
        self.write_cloud(TRUTH_FLOW_TOPIC, flow, truth.stamp_ns, frame_id, is_dense=is_known)
        if sweep.pose is not None:
            self.write_odometry(
                TRUTH_ODOMETRY_TOPIC, sweep.pose, truth.stamp_ns, ODOMETRY_FRAME, frame_id
            )

    def write_odometry(
        self,
        topic: str,
        pose: AnyFloats,
        stamp_ns: int,
        frame_id: str,
        child_frame_id: str,
        *,
        velocity: Floats | None = None,
        covariance: Floats | None = None,
    ) -> None:
        """Adds the (4, 4) pose, metres, of the child frame in `frame_id`.

        The velocity is (6,) along the axes of the child frame in m/s, then about them in rad/s;
        zero by default, and unknown with the covariance (6, 6) of an estimated pose.
        """
        with self._guarded():
            message = Messages("nav_msgs").Odometry(
                header=_header(stamp_ns, frame_id), child_frame_id=child_frame_id
            )
            _set_pose(message.pose.pose.position, message.pose.pose.orientation, pose)
            if velocity is not None:
                twist = message.twist.twist
                for vector, values in ((twist.linear, velocity[:3]), (twist.angular, velocity[3:])):
                    vector.x, vector.y, vector.z = values.tolist()
            if covariance is not None:
                message.pose.covariance = covariance.ravel()
                message.twist.covariance = UNKNOWN_COVARIANCE.ravel()
        self.write_message(topic, message, stamp_ns)

    def write_transforms(self, stamp_ns: int, poses: Mapping[tuple[str, str], AnyFloats]) -> None:
        """Adds transforms to `/tf`: frame and child frame to the (4, 4) pose of the child."""
        with self._guarded():
            message = Messages("tf2_msgs").TFMessage()
            for (frame_id, child_frame_id), pose in poses.items():
                one = Messages("geometry_msgs").TransformStamped(
                    header=_header(stamp_ns, frame_id), child_frame_id=child_frame_id
                )
                _set_pose(one.transform.translation, one.transform.rotation, pose)
                message.transforms.append(one)
        self.write_message(TF_TOPIC, message, stamp_ns)

    def write_objects(
        self, topic: str, objects: Sequence[TrackedObject], stamp_ns: int, frame_id: str
    ) -> None:
        """Adds objects as a cloud of `OBJECT_ROW`, and markers for viewers on `TOPIC/markers`."""
        cloud = encode_columns(object_columns(objects), 1, len(objects))
        self.write_cloud(topic, cloud, stamp_ns, frame_id)
        with self._guarded():
            header = _header(stamp_ns, frame_id)
            markers = objects_markers(Messages("visualization_msgs"), header, objects)
        self.write_message(f"{topic}/markers", markers, stamp_ns)

    def write_turn_rate(
        self, topic: str, rate: Sequence[float], stamp_ns: int, frame_id: str
    ) -> None:
        """Adds a turn rate, rad/s about x, y and z of the frame, as an Imu with nothing else."""
        with self._guarded():
            message = Messages("sensor_msgs").Imu(header=_header(stamp_ns, frame_id))
            vector = message.angular_velocity
            vector.x, vector.y, vector.z = rate
            for unknown in ("orientation_covariance", "linear_acceleration_covariance"):
                setattr(message, unknown, np.array([-1.0, *np.zeros(8)]))
        self.write_message(topic, message, stamp_ns)

    def _finish(self, kind: type[BaseException] | None, *_: object) -> None:
        self._writer = None
        if kind is None and not self._connections:
            raise ValueError("nothing was written, so there is no recording")

    @contextmanager
    def _guarded(self) -> Iterator[None]:
        try:
            yield
        except RecordingError:
            raise
        except UNREADABLE as error:
            raise RecordingError(f"{self.path}: cannot be written: {reason(error)}") from error


def _header(stamp_ns: int, frame_id: str) -> Any:  # noqa: ANN401 - a std_msgs/Header
    header = Messages("std_msgs").Header(frame_id=frame_id)
    header.stamp.sec, header.stamp.nanosec = encode_stamp(stamp_ns)
    return header


def _set_pose(place: Any, turn: Any, pose: AnyFloats) -> None:  # noqa: ANN401
    """Sets a position and a quaternion of ROS to a (4, 4) pose."""
    place.x, place.y, place.z = pose[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = pose_quaternion(pose)
