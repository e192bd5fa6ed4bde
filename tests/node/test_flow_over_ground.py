# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Velocities over ground, objects, and the ego motion."""

import itertools

import numpy as np
import pytest
from box_street import INTERVAL_NS, BoxStreet, pose, unrelated_sweep
from diagnostic_msgs.msg import DiagnosticStatus
from nav_msgs.msg import Odometry
from node_harness import QUICK, stamp_of
from rclpy.qos import DurabilityPolicy, QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import String
from synthetic_clouds import column, flow_columns, velocity_columns, xyz_columns, xyz_message
from visualization_msgs.msg import MarkerArray

from mnsf_ros.geometry.transforms import pose_matrix

STREET = BoxStreet()
POINTS_PER_CAR = 400
ON_STREET = QUICK | {"ground.remove": "true", "node.odom_frame": "front/odom"}
STEP_M, TURN_DEG = 0.6, 1.0
CAR_STEP_M = 0.9
START_NS = 500_000 * 10**9


def path(index):
    return pose(STEP_M * index, yaw_deg=TURN_DEG * index)


def street_message(index, drive_number=0):
    """The street with a car that drives ahead; the points of the car are the last ones."""
    car = (8 + CAR_STEP_M * index, -2.0)
    xyz = STREET.xyz(path(index), seed=index, cars=[car], points_per_box=POINTS_PER_CAR)
    return xyz_message(xyz, stamp_ns=START_NS + drive_number * 10**12 + index * INTERVAL_NS)


class Heard:
    """All messages of a topic, by the stamp of their sweep."""

    def __init__(self, peer, message_type, name, *, node="/street", latched=False):
        policy = DurabilityPolicy.TRANSIENT_LOCAL if latched else DurabilityPolicy.VOLATILE
        qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.RELIABLE, durability=policy)
        self.messages = []
        self._peer, self._name = peer, name
        peer.node.create_subscription(message_type, f"{node}/{name}", self.messages.append, qos)

    def of(self, cloud):
        """The message with the stamp of a cloud."""

        def found():
            return next((m for m in self.messages if stamp_of(m) == stamp_of(cloud)), None)

        return self._peer.spin_until(found, f"{self._name} of {stamp_of(cloud)}")


@pytest.fixture(scope="module")
def street_peer(run_node):
    peer = run_node(ON_STREET, name="/street")
    peer.wait_for_node()
    return peer


@pytest.fixture(scope="module")
def heard(street_peer):
    """Topic to what was heard on it; the node knows all subscriptions, however late."""
    types = {"ego_motion": Odometry, "objects": PointCloud2, "objects/markers": MarkerArray}
    heard = {name: Heard(street_peer, kind, name) for name, kind in types.items()}
    clouds = map(street_message, itertools.count())
    street_peer.send_until(clouds, lambda: all(h.messages for h in heard.values()), "all topics")
    street_peer.wait_until_settled()
    return heard


@pytest.fixture(scope="module")
def clouds(street_peer, heard):
    """A drive of ten sweeps whose messages have been heard."""
    clouds = [street_message(index, drive_number=1) for index in range(10)]
    # The flow of each before the next but one, so that none is dropped.
    street_peer.send(*clouds[:2])
    for current, newest in itertools.pairwise(clouds[1:]):
        street_peer.send(newest)
        street_peer.flow_of(current)
    return clouds


def test_velocity_is_over_ground_in_metres_per_second(street_peer, clouds):
    flow = street_peer.flow_of(clouds[2])
    is_dynamic = column(flow, "dynamic").astype(bool)
    assert is_dynamic.sum() < POINTS_PER_CAR * 1.2
    is_moving = is_dynamic[-POINTS_PER_CAR:]
    assert is_moving.mean() > 0.7
    velocities = velocity_columns(flow)[-POINTS_PER_CAR:][is_moving]
    expected = 10 * CAR_STEP_M * path(2)[0, :3]
    # A few sparse points at an end of the car may be an object of their own.
    assert (np.abs(velocities - expected).max(axis=1) < 0.4).mean() > 0.95
    # The flow itself has the sensor's motion in it: the car drives ahead of it slowly.
    ahead = flow_columns(flow)[-POINTS_PER_CAR:][is_moving]
    assert np.median(ahead[:, 0]) == pytest.approx(CAR_STEP_M - STEP_M, abs=0.08)


def test_ego_motion_is_the_pose_and_the_twist_of_the_sensor(heard, clouds):
    message = heard["ego_motion"].of(clouds[4])
    assert (message.header.frame_id, message.child_frame_id) == ("front/odom", "lidar")
    assert message.header.stamp == clouds[4].header.stamp
    np.testing.assert_allclose(pose_matrix(message.pose.pose), path(4), atol=0.03)
    twist = message.twist.twist
    # In the sensor's own axes, forward and to the left positive; the street goes along x.
    linear = (twist.linear.x, twist.linear.y, twist.linear.z)
    np.testing.assert_allclose(linear, 10 * STEP_M * path(4)[0, :3], atol=0.15)
    assert twist.angular.z == pytest.approx(np.radians(10 * TURN_DEG), abs=0.02)
    for covariance in (message.pose.covariance, message.twist.covariance):
        assert (np.linalg.eigvalsh(np.reshape(covariance, (6, 6))) > 0).all()


def test_the_car_is_one_object_with_a_velocity(heard, clouds):
    numbers = set()
    for index in range(5, 9):
        message, sensor = heard["objects"].of(clouds[index]), path(index)
        car = np.array([8 + CAR_STEP_M * index, -2.0, 0.0]) - sensor[:3, 3]
        offsets = xyz_columns(message)[:, :2] - (car @ sensor[:3, :3])[:2]
        nearest = np.linalg.norm(offsets, axis=1).argmin()
        np.testing.assert_allclose(offsets[nearest], 0, atol=0.3)
        velocity = 10 * CAR_STEP_M * sensor[0, :3]
        np.testing.assert_allclose(velocity_columns(message)[nearest], velocity, atol=0.3)
        numbers.add(int(column(message, "id")[nearest]))
    assert len(numbers) == 1
    shown = [{item.id for item in each.markers} for each in heard["objects/markers"].messages[-3:]]
    assert all(numbers <= ids for ids in shown)


def test_source_is_latched(street_peer, clouds):
    source = Heard(street_peer, String, "ego_motion/source", latched=True)
    street_peer.spin_until(lambda: source.messages, "the source, though it was said before")
    assert source.messages[-1].data == "registration"


def test_lost_ego_motion_is_told_at_once_and_ends_by_itself(run_node):
    peer = run_node(ON_STREET | {"node.diagnostics_period_s": 60.0}, name="/lost")
    source = Heard(peer, String, "ego_motion/source", node="/lost", latched=True)
    peer.wait_for_subscription("reliable")
    first = map(street_message, itertools.count())

    def has_flow():
        peer.publish(next(first))
        peer.spin_for(0.1)
        return peer.flows and source.messages

    peer.spin_until(has_flow, "a flow and its source")
    clouds = [street_message(index, drive_number=1) for index in range(20)]
    for index in (8, 9):
        xyz = unrelated_sweep(index).xyz
        clouds[index] = xyz_message(xyz, stamp_ns=stamp_of(clouds[index]))
    peer.publish(clouds[0])

    def goes_on(first, last):
        for index in range(first, last):
            peer.publish(clouds[index])
            if index > 1:
                peer.flow_of(clouds[index - 1])

    def is_of_level(level):
        return peer.diagnostics and peer.status("ego motion").level == level

    goes_on(1, 10)
    # The flow until a sweep that is lost has no value.
    assert not column(peer.flows[stamp_of(clouds[7])], "confidence").any()
    peer.spin_until(lambda: is_of_level(DiagnosticStatus.ERROR), "the loss to be told")
    text = "lost: the sweep does not match those before it; nothing counts as moving"
    assert peer.status("ego motion").message.startswith(text)
    assert source.messages[-1].data == "lost"
    goes_on(10, 20)
    peer.spin_until(lambda: is_of_level(DiagnosticStatus.WARN), "its end to be told")
    assert "it was lost in 3 of the last 10" in peer.status("ego motion").message
    assert [one.data for one in source.messages] == ["registration", "lost", "registration"]
    assert f"ego motion is {text}" in peer.process.log
