# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps, poses and turn rates of a recording, each in the order of its stamps."""

import math
from bisect import insort
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from operator import attrgetter
from typing import Any, Final

import numpy as np

from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.geometry.pose_track import PoseTrack, StampedPose
from mnsf_ros.geometry.stamped_rate import StampedRate
from mnsf_ros.geometry.stamped_track import Item
from mnsf_ros.geometry.transforms import sensor_mount, transform_matrix
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import IMU_TYPE, TF_TYPE, UsedTopics
from mnsf_ros.recording.static_frames import StaticFrames
from mnsf_ros.recording.storage_file import Damage
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.rate_track import RateTrack, are_covered
from mnsf_ros.sweeps.revolutions import Revolutions
from mnsf_ros.sweeps.sweep import Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudReader, CloudSource
from mnsf_ros.sweeps_io.several_lidars import joined_times, revolution_sweep
from msg_utils.errors import MessageError
from msg_utils.point_times import PointTimes
from msg_utils.stamps import decode_stamp

# Messages that are looked at ahead to put them in the order of their header stamps.
_ORDER_WINDOW: Final = 4


def recorded_sweeps(
    reader: BagReader, topic: str, recording: str, settings: Settings, findings: Findings
) -> Iterator[Sweep | None]:
    """Yields the sweeps of a topic, `source` is a CloudSource; None for a gap.

    `findings` collect events and damage.
    """
    imu = _RecordedImu(reader, settings, findings)
    for parts in _recorded_revolutions(reader, topic, settings, findings):
        yield imu.turning(_of_recorded_rows(parts, recording)) if parts else None


def recorded_clouds(
    reader: BagReader, topics: UsedTopics, settings: Settings, findings: Findings
) -> Iterator[Sweep]:
    """Yields the sweeps of a recording with odometry, revolutions with one message.

    `source` is a CloudSource. `findings` collect events and damage.
    """
    imu = _RecordedImu(reader, settings, findings)
    poses = recorded_track(reader, topics.odometry, settings, findings)
    for parts in filter(None, _recorded_revolutions(reader, topics.points, settings, findings)):
        sweep = imu.turning(revolution_sweep(parts))
        pose = poses.pose_at(sweep.stamp_ns)
        yield sweep if pose is None else replace(sweep, odometry=pose.world_from_frame)


class _RecordedImu:
    """Adds turn rates to sweeps: of the first IMU whose rotation to the lidar is known."""

    def __init__(self, reader: BagReader, settings: Settings, findings: Findings) -> None:
        self._tracks = [
            RateTrack(decoded(reader, topic, findings, lambda imu, _: StampedRate.of(imu)))
            for topic, summary in reader.topics.items()
            if settings.ego_motion.imu and summary.has_messages(IMU_TYPE)
        ]
        self._frames = StaticFrames(reader) if self._tracks else None
        self._findings = findings

    def turning(self, sweep: Sweep) -> Sweep:
        """Returns the sweep with its turn rates, if they are known."""
        if self._frames is None:
            return sweep
        for track in self._tracks:
            rates = track.around(sweep)
            pose = self._frames.find(sweep.frame_id, track.frame_id)
            if pose is not None:
                is_covered = are_covered(rates, *sweep.span_s)
                self._findings.count(Event.SWEEPS_WITHOUT_RATES, int(not is_covered))
                return sweep.turning(rates, pose)
        self._findings.count(Event.IMU_UNPLACED)
        return sweep


def _recorded_revolutions(
    reader: BagReader, topic: str, settings: Settings, findings: Findings
) -> Iterator[Sequence[Sweep]]:
    """Revolutions, each as its parts, in order; without parts for a gap."""
    clouds = CloudReader()

    def sweep_of(message: Any, received_ns: int) -> Sweep:  # noqa: ANN401 - a PointCloud2
        sweep = clouds.sweep(message, settings.time, received_ns)
        cloud: CloudSource = sweep.source
        findings.count(Event.SWEEPS_UNSTAMPED, int(not cloud.is_stamped))
        findings.count(Event.SWEEPS_TIMES_UNUSED, int(bool(cloud.times.fault)))
        findings.count(Event.POINTS_UNTIMED, cloud.num_untimed)
        return sweep

    revolutions = Revolutions()
    for cloud in decoded(reader, topic, findings, sweep_of):
        found = [()] if cloud is None else revolutions.add(cloud, settings.buffer)
        for parts in found:
            if cloud is not None and not parts:
                # The mounting was estimated from a part of a revolution.
                findings.mounting.forget()
            findings.count(Event.PARTS, len(parts) if len(parts) > 1 else 0)
            yield _checked(parts, findings)
    if revolutions.rest:
        yield _checked(revolutions.rest, findings)


def _checked(parts: Sequence[Sweep], findings: Findings) -> Sequence[Sweep]:
    if findings.input_check is not None:
        for part in parts:
            findings.input_check.add(part, len(parts))
    return parts


def _of_recorded_rows(parts: Sequence[Sweep], recording: str) -> Sweep:
    """The parts as one sweep with the stamp of the first; its rows are those of the recording."""
    first = parts[0]
    if len(parts) == 1:
        return replace(first, source=replace(first.source, recording=recording))
    times = PointTimes(joined_times(parts, first.stamp_ns))
    measured = np.concatenate([part.source.measured for part in parts])
    source = CloudSource(None, measured, times, recording=recording, parts=parts)
    xyz = np.concatenate([part.xyz for part in parts])
    return replace(first, xyz=xyz, times_s=times.times_s, source=source)


def recorded_poses(
    reader: BagReader, topic: str, fixed_frame: str, findings: Findings
) -> Iterator[StampedPose | None]:
    """Yields the poses of a topic in stamp order, None for a gap.

    On a topic of transforms, these are the poses of the first frame that moves in the fixed frame.
    """
    child = ""

    def transform_of(message: Any, _: int) -> StampedPose | None:  # noqa: ANN401 - a TFMessage
        nonlocal child
        for one in message.transforms:
            names = one.header.frame_id.lstrip("/"), one.child_frame_id.lstrip("/")
            if names[0] == fixed_frame and names[1] == (child or names[1]):
                child = names[1]
                return StampedPose(
                    decode_stamp(one.header.stamp), transform_matrix(one.transform), child
                )
        return None

    if reader.topics[topic].msgtype == TF_TYPE:
        return decoded(reader, topic, findings, transform_of)
    return decoded(reader, topic, findings, lambda message, _: StampedPose.of(message))


def recorded_track(
    reader: BagReader, topic: str | None, settings: Settings, findings: Findings
) -> PoseTrack:
    """Returns the poses of the sensor from those on a topic; none without a topic."""
    fixed_frame = settings.tf.fixed_frame
    recorded = () if topic is None else recorded_poses(reader, topic, fixed_frame, findings)
    return PoseTrack(recorded, sensor_mount(settings.ego_motion))


def decoded(
    reader: BagReader, topic: str, findings: Findings, decode: Callable[[Any, int], Item | None]
) -> Iterator[Item | None]:
    """Yields the decoded messages of a topic in stamp order, see `_in_stamp_order`.

    None stands for a damaged message; those that `decode` returns None for are left out.
    """
    return _in_stamp_order(_as_received(reader, topic, findings, decode))


def _as_received(
    reader: BagReader, topic: str, findings: Findings, decode: Callable[[Any, int], Item | None]
) -> Iterator[Item | None]:
    for number, item in enumerate(reader.readable_messages(topic)):
        if isinstance(item, Damage):
            if item.is_memory:
                raise item.error()  # the file is intact, and a larger limit reads it
            findings.report(item)
            yield None
            continue
        received_ns, message = item
        try:
            found = decode(message, received_ns)
        except MessageError as error:
            where = f"message {number} on {topic!r}"
            findings.report(Damage(str(reader.path), where, str(error)))
            yield None
            continue
        if found is not None:
            yield found


def _in_stamp_order(items: Iterator[Item | None]) -> Iterator[Item | None]:
    """Sorts items by stamp within a window, which ends at a gap or a larger step back in time."""
    window: list[Item] = []
    last_ns = -math.inf
    for item in items:
        if item is None or item.stamp_ns < last_ns:
            yield from window
            window.clear()
            last_ns = -math.inf
        if item is None:
            yield None
            continue
        insort(window, item, key=attrgetter("stamp_ns"))
        if len(window) > _ORDER_WINDOW:
            oldest = window.pop(0)
            last_ns = oldest.stamp_ns
            yield oldest
    yield from window
