# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Input of the pipeline: from topics to sweeps with the pose of the sensor, of all lidars."""

import time
from collections import deque
from collections.abc import Callable, Container, Iterator
from contextlib import suppress
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header

from mnsf_ros.arrays import Floats
from mnsf_ros.geometry.transforms import mounted_at
from mnsf_ros.node.cloud_topics import cloud_topics, unusable_topics
from mnsf_ros.node.diagnostics import InputState
from mnsf_ros.node.subscriptions import (
    ImuInput,
    InputSubscription,
    OdometryInput,
    Report,
    decoded,
)
from mnsf_ros.node.transforms import TransformError, Transforms
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.mounting import Mounting
from mnsf_ros.sweeps.revolutions import Revolutions
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudReader
from mnsf_ros.sweeps_io.several_lidars import (
    ArrivedSweep,
    LidarGroup,
    LidarGroups,
    merged_sweep,
    revolution_sweep,
)

TRANSFORMS_MISSING: Final = "transforms_missing"

_POLL_PERIOD_S: Final = 0.02
# More sweeps than any lidar sends within the longest wait.
_MAX_WAITING: Final = 50
_UP: Final = np.array([0.0, 0.0, 1.0])
# A stamp this much older than the last one means that the clock jumped, as when a bag loops.
_JUMP_NS: Final = NANOSECONDS


class SweepInput:
    """Subscribes to lidars, IMU, odometry and transforms; hands out sweeps in their order.

    A sweep waits for its transform, and later sweeps behind it, at most for `tf.timeout_s`.

    Attributes:
        pause: Reason for ignoring clouds; empty if they are not ignored.
        transforms: Transforms between frames; None while the settings need none.
        num_parts: Clouds in the last revolution.
    """

    def __init__(
        self,
        node: Node,
        settings: Settings,
        report: Report,
        on_sweep: Callable[[Sweep, int], None],
        pause: str = "",
        on_break: Callable[[], None] = lambda: None,
    ) -> None:
        """Subscribes; `on_sweep` gets each sweep and its `time.monotonic_ns()` of arrival.

        `on_break` is called where the sweeps before were none, but parts of a revolution.

        Raises:
            SettingsError: If the settings need transforms, and tf2_ros is missing.
        """
        self.pause = pause
        self.transforms: Transforms | None = None
        self._node, self._report, self._on_sweep = node, report, on_sweep
        self._on_break = on_break
        self._times_source = ""
        self._odometry = OdometryInput(node, report)
        self._imu = ImuInput(node, report)
        self._waiting: deque[ArrivedSweep] = deque()
        self._revolutions = [Revolutions() for _ in range(settings.lidars.count)]
        self.num_parts = 1
        self._last_ns = 0
        self._mountings: dict[str, Mounting] = {}  # by frame_id
        # They need neither odometry, nor an IMU, nor transforms.
        self._settings = Settings().changed({"ego_motion.imu": False})
        self.change_settings(settings)
        self._timer = node.create_timer(
            _POLL_PERIOD_S, self._release, clock=Clock(clock_type=ClockType.STEADY_TIME)
        )
        self._timer.cancel()
        count = settings.lidars.count
        self._clouds = [CloudReader() for _ in range(count)]
        self._subscriptions = [self._subscribed(index) for index in range(count)]
        topics = tuple(subscription.topic for subscription in self._subscriptions)
        self._merging = LidarMerging(topics, report) if count > 1 else None

    @property
    def state(self) -> InputState:
        """Input state for diagnostics."""
        own = self._node.get_name(), self._node.get_namespace()
        topics = ", ".join(subscription.topic for subscription in self._subscriptions)
        return InputState(
            "any topic" if self.is_searching else topics,
            self._subscriptions[0].reliability,
            sum(subscription.num_publishers for subscription in self._subscriptions),
            self._times_source,
            self.pause,
            () if self._merging is None else self._merging.missing,
            self._node.get_node_names_and_namespaces().count(own) - 1,
            num_parts=self.num_parts,
            imu=self._imu.text,
        )

    @property
    def is_searching(self) -> bool:
        """Whether no topic is named, so that the only one with clouds will be taken."""
        return self._subscriptions[0].is_searching

    @property
    def is_played(self) -> bool:
        """Whether clouds come from a program that plays recordings, whose stamps are old."""
        return any(subscription.is_played for subscription in self._subscriptions)

    @property
    def silence(self) -> str:
        """Why no sweep comes, as far as the ROS graph tells."""
        causes = [fault for one in self._subscriptions if (fault := one.fault)]
        own = {subscription.topic for subscription in self._subscriptions}
        others = [topic for topic in cloud_topics(self._node) if topic not in own]
        if others:
            is_taken = len(others) == 1 and self.is_searching
            advice = "name one of them (node: remap ~/points; launch: points:=TOPIC)"
            then = "the only topic, which is taken in a moment" if is_taken else advice
            causes.append(f"clouds are on {', '.join(others)}: {then}")
        causes = causes or unusable_topics(self._node)
        return "; ".join(causes) or "no clouds are published, see ROS_DOMAIN_ID if some should be"

    def refresh(self) -> None:
        """Subscribes anew where the publishers have changed."""
        for subscription in self._subscriptions:
            subscription.refresh()

    def change_settings(self, settings: Settings) -> None:
        """Applies other settings from the next sweep on.

        Raises:
            SettingsError: If they need transforms, and tf2_ros is missing; nothing changes.
        """
        purpose = _purpose_of_transforms(settings)
        if purpose and self.transforms is None:
            self.transforms = Transforms(self._node, purpose)
        elif not purpose and self.transforms is not None:
            self.transforms.close()
            self.transforms = None
        is_same = settings.ego_motion == self._settings.ego_motion
        self._settings = settings
        if not is_same:
            self._change_ego_motion()

    def reset(self) -> None:
        """Forgets all waiting sweeps and earlier poses."""
        self._waiting.clear()
        self._mountings.clear()
        self._revolutions = [Revolutions() for _ in self._revolutions]
        if self._merging is not None:
            self._merging.clear()
        self._change_ego_motion()

    def _change_ego_motion(self) -> None:
        settings = self._settings.ego_motion
        self._odometry.change_settings(settings, self.transforms)
        self._imu.change_settings(settings)

    def _subscribed(self, index: int) -> InputSubscription:
        return InputSubscription(
            self._node,
            f"~/points_{index + 1}" if index else "~/points",
            self._settings.node.input_reliability,
            partial(self._on_cloud, index),
            self._report,
            may_search=self._settings.lidars.count == 1,
        )

    def _on_cloud(self, index: int, message: PointCloud2) -> None:
        if self.pause:
            return
        arrived_ns = time.monotonic_ns()
        now_ns = self._node.get_clock().now().nanoseconds
        sweep = decoded(self._clouds[index], message, self._settings.time, now_ns, self._report)
        if sweep is None:
            return
        self._times_source = sweep.source.times.source
        for parts in self._revolutions[index].add(sweep, self._settings.buffer):
            self.num_parts = len(parts)
            if not parts:
                self._on_break()
                continue
            item = ArrivedSweep(revolution_sweep(parts), arrived_ns)
            if self._merging is None:
                self._queue(item)
            else:
                self._merging.add(index, item, self._settings.lidars)
        self._release()

    def _queue(self, item: ArrivedSweep) -> None:
        stamp_ns = item.sweep.stamp_ns
        if self.transforms is not None and stamp_ns < self._last_ns - _JUMP_NS:
            self.transforms.forget()
        self._last_ns = stamp_ns
        self._waiting.append(item)

    def _release(self) -> None:
        """Hands out the sweeps that are ready; the timer repeats it while any wait."""
        if self._merging is not None:
            transforms = self.transforms if self._settings.lidars.poses == "tf" else None
            for item in self._merging.merged(self._settings, transforms):
                self._queue(item)
        self._hand_out()
        if self._waiting or (self._merging is not None and self._merging.is_waiting):
            self._timer.reset()
        else:
            self._timer.cancel()

    def _hand_out(self) -> None:
        timeout_ns = self._settings.tf.timeout_s * NANOSECONDS
        while self._waiting:
            first = self._waiting[0]
            is_late = time.monotonic_ns() - first.arrived_ns >= timeout_ns
            may_wait = not is_late and len(self._waiting) <= _MAX_WAITING
            sweep = self._located(first.sweep, may_wait=may_wait)
            if sweep is None:
                return
            self._waiting.popleft()
            self._on_sweep(self._imu.turning(self._mounted(sweep)), first.arrived_ns)

    def _mounted(self, sweep: Sweep) -> Sweep:
        """The sweep with the mounting of its lidar by TF, if that is known; it is kept."""
        lidars, frame_id = self._settings.lidars, sweep.frame_id
        if self.transforms is None or lidars.poses != "tf" or frame_id == lidars.frame:
            return sweep
        if frame_id not in self._mountings:
            with suppress(TransformError):
                pose = self.transforms.find(lidars.frame, frame_id)
                # The frame of a lidar has its lens at the origin.
                self._mountings[frame_id] = Mounting.of(pose[2, :3], np.zeros(3), "by TF")
        return replace(sweep, mounting=self._mountings.get(frame_id))

    def _located(self, sweep: Sweep, *, may_wait: bool) -> Sweep | None:
        """The sweep with the sensor's pose, if that is known; None if it may still arrive."""
        by_tf = self._settings.ego_motion.source == "tf"
        try:
            if by_tf and self.transforms is not None:
                fixed_frame = self.transforms.fixed_frame(self._settings.tf.fixed_frame)
                pose = self.transforms.find(fixed_frame, sweep.frame_id, sweep.stamp_ns)
                return replace(sweep, odometry=pose)
            return self._odometry.located(sweep)
        except TransformError as error:
            if by_tf and may_wait:
                return None
            self._report(TRANSFORMS_MISSING, f"{error}; registration is used instead")
            return sweep


def _purpose_of_transforms(settings: Settings) -> str:
    """The setting that needs transforms; empty if none does."""
    ego_motion, tf = settings.ego_motion, settings.tf
    if ego_motion.source == "tf":
        return "ego_motion.source: tf"
    if ego_motion.source == "odometry" and ego_motion.sensor_pose == "tf":
        return "ego_motion.sensor_pose: tf"
    if settings.lidars.count > 1 and settings.lidars.poses == "tf":
        return "lidars.poses: tf"
    return "tf.base_frame" if tf.broadcast and tf.base_frame else ""


class LidarMerging(LidarGroups):
    """Merges the sweeps of a group whose lidars have a known pose.

    Attributes:
        missing: Topics of the lidars that are not in the last merged sweep.
    """

    missing: tuple[str, ...] = ()
    # Between all lidars that were ever merged: the best single place to see the cloud from.
    _mounting: Mounting | None = None
    _num_merged = 0

    def __init__(self, topics: tuple[str, ...], report: Report) -> None:
        super().__init__(len(topics))
        self._topics, self._report = topics, report

    def merged(self, settings: Settings, transforms: Transforms | None) -> Iterator[ArrivedSweep]:
        """Yields merged sweeps, with the arrival of the reference lidar's sweep."""
        for group in self.due(time.monotonic(), settings.lidars):
            poses = self._poses(group, settings, transforms)
            self._tell_missing(group, poses)
            if poses:
                sweeps = {index: group.sweeps[index].sweep for index in poses}
                stamp_ns = group.reference.sweep.stamp_ns
                header = Header(frame_id=settings.lidars.frame)
                header.stamp.sec, header.stamp.nanosec = divmod(stamp_ns, NANOSECONDS)
                if len(poses) > self._num_merged:
                    self._num_merged = len(poses)
                    lens_m = np.mean([pose[:3, 3] for pose in poses.values()], axis=0)
                    self._mounting = Mounting.of(_UP, lens_m, "between the lidars")
                sweep = merged_sweep(sweeps, poses, stamp_ns, header, self._mounting)
                yield ArrivedSweep(sweep, group.reference.arrived_ns)

    def _poses(
        self, group: LidarGroup, settings: Settings, transforms: Transforms | None
    ) -> dict[int, Floats]:
        """Number of a lidar -> its pose (4, 4) in the common frame, where that is known."""
        if transforms is None:
            mounts = (settings.lidar_1, settings.lidar_2, settings.lidar_3, settings.lidar_4)
            return {index: mounted_at(mounts[index]) for index in group.sweeps}
        poses = {}
        for index, item in group.sweeps.items():
            try:
                poses[index] = transforms.find(settings.lidars.frame, item.sweep.frame_id)
            except TransformError as error:
                event = f"clouds_of_lidar_{index + 1}_without_transform"
                self._report(event, f"{error}; it is left out")
        return poses

    def _tell_missing(self, group: LidarGroup, merged: Container[int]) -> None:
        missing = []
        for index, topic in enumerate(self._topics):
            clouds, name = f"clouds_of_lidar_{index + 1}", topic
            if index in group.clocks_ahead_s:
                name += f" (its stamps are {_apart(group.clocks_ahead_s[index])})"
                self._report(f"{clouds}_of_another_time", f"merged without {name}")
            elif index not in group.sweeps:
                text = (
                    f"no cloud of {topic} is near in time: merged without it (see "
                    "lidars.tolerance_s, lidars.max_wait_s)"
                )
                self._report(f"{clouds}_missing", text)
            if index not in merged:
                missing.append(name)
        self.missing = tuple(missing)


def _apart(ahead_s: float) -> str:
    return f"{abs(ahead_s):.1f} s {'ahead' if ahead_s > 0 else 'behind'}"
