# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Poses by TF and on TF, with the real tf2 where it is installed; see test_sweep_input, too."""

from __future__ import annotations

import importlib.util
import itertools

import numpy as np
import pytest
from box_street import INTERVAL_NS, BoxStreet, pose
from diagnostic_msgs.msg import DiagnosticStatus
from geometry_msgs.msg import TransformStamped
from nav_msgs.msg import Odometry
from scene_flow_process import QUICK
from scipy.spatial.transform import Rotation
from synthetic_clouds import xyz_message

HAS_TF2 = importlib.util.find_spec("tf2_ros") is not None
STREET = BoxStreet()
START_NS = 700_000 * 10**9
MOUNT = pose(1.2, 0.1, 1.5, yaw_deg=30)  # base_link_from_lidar
ORIGIN = pose(40, -10, 0, yaw_deg=70)  # odom_from_base, at the first sweep
MISSING = "transforms_missing"


@pytest.mark.skipif(HAS_TF2, reason="tf2_ros is installed")
class TestWithoutTf2:
    def test_the_start_fails_and_says_what_to_install(self, start_node):
        process = start_node({"tf.broadcast": "true"})
        assert process.wait() == 2
        (fatal,) = (line for line in process.log.splitlines() if "[FATAL]" in line)
        assert "tf.broadcast needs the Python package tf2_ros" in fatal
        assert "apt install" in fatal

    @pytest.mark.parametrize(
        "changes",
        [
            {"ego_motion.source": "tf"},
            {"ego_motion.source": "odometry", "ego_motion.sensor_pose": "tf"},
        ],
        ids=lambda changes: next(reversed(changes)),
    )
    def test_a_change_while_it_runs_is_refused(self, peer, changes):
        result = peer.set_atomically(changes)
        assert not result.successful
        assert next(reversed(changes)) in result.reason
        assert "tf2_ros" in result.reason
        assert peer.get("ego_motion.source") == "registration"


def base_pose(index):
    return ORIGIN @ pose(0.6 * index, yaw_deg=1.0 * index)


def transform(parent, child, matrix, stamp_ns=0):
    message = TransformStamped(child_frame_id=child)
    message.header.frame_id = parent
    message.header.stamp.sec, message.header.stamp.nanosec = divmod(stamp_ns, 10**9)
    place, turn = message.transform.translation, message.transform.rotation
    place.x, place.y, place.z = matrix[:3, 3].tolist()
    turn.x, turn.y, turn.z, turn.w = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
    return message


class Robot:
    """Drives a street with a lidar on a mount; each has a time and frames of its own."""

    numbers = itertools.count()

    def __init__(self, peer, transforms):
        self.number = next(self.numbers)
        self.peer = peer
        self.odom, self.base, self.lidar = (
            f"{name}_{self.number}" for name in ("odom", "base", "lidar")
        )
        self._transforms = transforms

    def stamp_ns(self, index):
        return START_NS + self.number * 10**12 + round(index * INTERVAL_NS)

    def cloud(self, index):
        lidar_pose = np.linalg.inv(ORIGIN) @ base_pose(index) @ MOUNT
        xyz = STREET.xyz(lidar_pose, seed=index)
        return xyz_message(xyz, stamp_ns=self.stamp_ns(index), frame_id=self.lidar)

    def mount(self):
        self._transforms.fixed(transform(self.base, self.lidar, MOUNT))

    def odometry_transform(self, index):
        stamp_ns = self.stamp_ns(index)
        self._transforms.send(transform(self.odom, self.base, base_pose(index), stamp_ns))

    def wanted_motion(self, first, second):
        """(4, 4) first_from_second of the lidar."""
        poses = [base_pose(index) @ MOUNT for index in (first, second)]
        return np.linalg.inv(poses[0]) @ poses[1]


class TransformPublishers:
    def __init__(self, node):
        import tf2_ros

        self.send = tf2_ros.TransformBroadcaster(node).sendTransform
        self.fixed = tf2_ros.StaticTransformBroadcaster(node).sendTransform


def matrix_of(place, turn):
    matrix = np.eye(4)
    matrix[:3, 3] = place.x, place.y, place.z
    matrix[:3, :3] = Rotation.from_quat([turn.x, turn.y, turn.z, turn.w]).as_matrix()
    return matrix


@pytest.mark.skipif(not HAS_TF2, reason="tf2_ros is not installed")
class TestWithTf2:
    @pytest.fixture(scope="class")
    def tf_peer(self, run_node):
        parameters = QUICK | {"ground.remove": "true", "ego_motion.source": "tf"}
        parameters |= {"tf.timeout_s": 1.0, "tf.broadcast": "true", "tf.base_frame": "base_0"}
        peer = run_node(parameters, name="/tf")
        peer.wait_for_node()
        return peer

    @pytest.fixture(scope="class")
    def transforms(self, tf_peer):
        transforms = TransformPublishers(tf_peer.node)
        tf_peer.spin_until(
            lambda: tf_peer.node.count_subscribers("/tf_static") >= 1, "the node to listen"
        )
        return transforms

    @pytest.fixture
    def robot(self, tf_peer, transforms):
        robot = Robot(tf_peer, transforms)
        assert tf_peer.set({"tf.fixed_frame": robot.odom})[0].successful
        return robot

    @pytest.fixture(scope="class")
    def heard(self, tf_peer):
        poses = {}
        tf_peer.node.create_subscription(
            Odometry,
            "/tf/ego_motion",
            lambda message: poses.update({message.header.stamp.nanosec: message}),
            50,
        )
        tf_peer.spin_until(lambda: tf_peer.node.count_publishers("/tf/ego_motion"), "a publisher")
        return poses

    def drive(self, robot, num_sweeps=5, *, send_transform=None):
        clouds = [robot.cloud(index) for index in range(num_sweeps)]
        for index, cloud in enumerate(clouds):
            robot.peer.publish(cloud)
            # The transform of a sweep comes after it: the sweep waits.
            robot.peer.spin_for(0.05)
            if send_transform is not None:
                send_transform(index)
            if index >= 2:
                robot.peer.flow_of(clouds[index - 1])
            robot.peer.spin_for(0.02)
        robot.peer.wait_until_settled()
        return clouds

    def test_ego_motion_is_looked_up_though_transforms_come_late(self, robot, heard):
        robot.mount()
        before = robot.peer.count(MISSING)
        self.drive(robot, send_transform=robot.odometry_transform)
        assert robot.peer.count(MISSING) == before
        assert robot.peer.values("ego motion")["source"] == "tf"
        assert robot.peer.status("ego motion").level == DiagnosticStatus.OK
        poses = [
            matrix_of(
                heard[robot.stamp_ns(index) % 10**9].pose.pose.position,
                heard[robot.stamp_ns(index) % 10**9].pose.pose.orientation,
            )
            for index in (1, 3)
        ]
        motion = np.linalg.inv(poses[0]) @ poses[1]
        # Registration is centimetres off here; TF is not.
        np.testing.assert_allclose(motion, robot.wanted_motion(1, 3), atol=1e-4)

    def test_pose_is_broadcast_for_the_frame_of_the_robot(self, robot, heard, transforms):
        import tf2_ros
        from rclpy.time import Time

        # The one that the node broadcasts is that of the first robot.
        robot.base, robot.lidar = "base_0", f"lidar_{robot.number}"
        robot.mount()
        buffer = tf2_ros.Buffer()
        listener = tf2_ros.TransformListener(buffer, robot.peer.node)
        robot.peer.spin_for(0.3)
        assert robot.peer.set({"ego_motion.source": "registration"})[0].successful
        try:
            self.drive(robot)
            stamp = Time(nanoseconds=robot.stamp_ns(2))
            robot.peer.spin_until(
                lambda: buffer.can_transform("scene_flow_odom", robot.lidar, stamp), "the frame"
            )
            found = buffer.lookup_transform("scene_flow_odom", robot.lidar, stamp).transform
            message = heard[robot.stamp_ns(2) % 10**9].pose.pose
            np.testing.assert_allclose(
                matrix_of(found.translation, found.rotation),
                matrix_of(message.position, message.orientation),
                atol=1e-6,
            )
        finally:
            listener.unregister()
            assert robot.peer.set({"ego_motion.source": "tf"})[0].successful
