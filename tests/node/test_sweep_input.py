# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps wait for their transforms; tf2_ros itself, which few machines have, is replaced here."""

from __future__ import annotations

import sys
import time
import types

import numpy as np
import pytest
import rclpy
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from rclpy.executors import SingleThreadedExecutor
from scene_flow_process import PATIENCE_S
from sensor_msgs.msg import PointCloud2
from synthetic_clouds import xyz_columns

from mnsf_ros.node import sweep_input
from mnsf_ros.node.sweep_input import SweepInput
from mnsf_ros.settings import Settings


class Tf2(types.ModuleType):
    """The parts of tf2_ros that the input uses.

    Attributes:
        found: Target frame, source frame and stamp (0: newest) to x of the transform, metres.
        num_clears: How often the buffer was cleared.
    """

    TransformException = LookupError

    def __init__(self):
        super().__init__("tf2_ros")
        self.found, self.num_clears = {}, 0

    def Buffer(self):  # noqa: N802 - as in tf2_ros
        return self

    def TransformListener(self, _buffer, _node):  # noqa: N802
        return types.SimpleNamespace(unregister=lambda: None)

    def clear(self):
        self.num_clears += 1

    def lookup_transform(self, target, source, stamp):
        message = TransformStamped()
        message.transform.rotation.w = 1.0
        message.transform.translation.x = self.found[target, source, stamp.nanoseconds]
        return message


class Input:
    """The input under test, the lidars in front of it, and the sweeps behind it."""

    def __init__(self, changes):
        self.sweeps, self.events = [], []
        self.node = rclpy.create_node("input")
        settings = Settings().changed({"node.input_reliability": "reliable"} | changes)
        self.input = SweepInput(self.node, settings, self._report, self._on_sweep)
        self._executor = SingleThreadedExecutor()
        self._executor.add_node(self.node)
        topics = ["~/points", "~/points_2"][: settings.lidars.count]
        self._publishers = [self.node.create_publisher(PointCloud2, name, 10) for name in topics]
        for publisher in self._publishers:
            self.spin_until(lambda p=publisher: p.get_subscription_count() == 1)

    def _report(self, event, _text, how_many=1):
        self.events.append(event)

    def _on_sweep(self, sweep, _arrived_ns):
        self.sweeps.append(sweep)

    def publish(self, *clouds, lidar=0):
        for cloud in clouds:
            self._publishers[lidar].publish(cloud)

    def spin_until(self, condition):
        give_up = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < give_up
            self._executor.spin_once(timeout_sec=0.02)

    def close(self):
        self._executor.shutdown()
        self.node.destroy_node()


@pytest.fixture
def tf2(monkeypatch):
    module = Tf2()
    monkeypatch.setitem(sys.modules, "tf2_ros", module)
    return module


@pytest.fixture
def make(ros, tf2):
    made = []

    def make(**changes):
        made.append(Input({name.replace("__", "."): value for name, value in changes.items()}))
        return made[-1]

    yield make
    for each in made:
        each.close()


@pytest.fixture
def clock_ns(monkeypatch):
    """The time of the input, in a list of one."""
    now_ns = [0]
    clock = types.SimpleNamespace(monotonic_ns=lambda: now_ns[0])
    monkeypatch.setattr(sweep_input, "time", clock)
    return now_ns


def test_sweeps_wait_for_their_transform_in_order_and_for_a_time(make, tf2, drive, clock_ns):
    lidar = make(ego_motion__source="tf", tf__timeout_s=0.5)
    lidar.publish(*drive.sweeps(0, 1))
    tf2.found["odom", "lidar", drive.stamp_ns(1)] = 2.0
    lidar.spin_until(lambda: len(lidar.input._waiting) == 2)
    # The second one has its transform, and waits behind the first.
    assert lidar.sweeps == []
    tf2.found["odom", "lidar", drive.stamp_ns(0)] = 1.0
    lidar.spin_until(lambda: len(lidar.sweeps) == 2)
    assert [sweep.odometry[0, 3] for sweep in lidar.sweeps] == [1.0, 2.0]
    lidar.publish(drive.sweep(2))
    lidar.spin_until(lambda: lidar.input._waiting)
    assert lidar.events == []
    clock_ns[0] += 500_000_000
    lidar.spin_until(lambda: len(lidar.sweeps) == 3)
    assert lidar.sweeps[2].odometry is None
    assert lidar.events == ["transforms_missing"]


def test_a_clock_that_jumps_back_clears_the_transforms(make, tf2, drive):
    lidar = make(ego_motion__source="tf", tf__timeout_s=0.0)
    lidar.publish(drive.sweep(0), drive.sweep(20), drive.sweep(15))
    lidar.spin_until(lambda: len(lidar.sweeps) == 3)
    assert tf2.num_clears == 0
    lidar.publish(drive.sweep(0))
    lidar.spin_until(lambda: len(lidar.sweeps) == 4)
    assert tf2.num_clears == 1


def test_odometry_is_of_a_frame_whose_lidar_is_looked_up(make, tf2, drive):
    lidar = make(ego_motion__source="odometry", ego_motion__sensor_pose="tf")
    odometry = lidar.node.create_publisher(Odometry, "~/odometry", 10)
    lidar.spin_until(lambda: odometry.get_subscription_count() == 1)
    for index in range(3):
        message = Odometry(child_frame_id="base_link", header=drive.sweep(index).header)
        message.pose.pose.orientation.w = 1.0
        message.pose.pose.position.x = 10.0 + index
        odometry.publish(message)
    lidar.spin_until(lambda: lidar.input._odometry._track.pose_at(drive.stamp_ns(2)) is not None)
    lidar.publish(drive.sweep(0))
    lidar.spin_until(lambda: len(lidar.sweeps) == 1)
    assert lidar.sweeps[0].odometry is None
    assert lidar.events == ["transforms_missing"]
    tf2.found["base_link", "lidar", 0] = 0.5
    lidar.publish(drive.sweep(1))
    lidar.spin_until(lambda: len(lidar.sweeps) == 2)
    assert lidar.sweeps[1].odometry[0, 3] == 11.5


def test_lidars_are_merged_by_their_places_and_left_out_without_one(make, tf2, drive):
    lidars = make(lidars__count=2, lidars__frame="body", lidars__max_wait_s=1.0)
    tf2.found["body", "front", 0] = 1.0
    for index in range(2):
        for number, frame in enumerate(("front", "rear")):
            lidars.publish(drive.sweep(index, frame_id=frame), lidar=number)
        lidars.spin_until(lambda index=index: len(lidars.sweeps) == index + 1)
        tf2.found["body", "rear", 0] = -1.0
    alone, both = (sweep.source.message for sweep in lidars.sweeps)
    assert lidars.events == ["clouds_of_lidar_2_without_transform"]
    assert (alone.width, both.width) == (1200, 2400)
    assert both.header.frame_id == "body"
    front, rear = xyz_columns(both)[:1200], xyz_columns(both)[1200:]
    np.testing.assert_allclose(front - rear, np.broadcast_to([2.0, 0, 0], front.shape), atol=1e-5)
