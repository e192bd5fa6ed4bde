# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Two lidars on one robot: one flow cloud in the frame of the robot."""

from __future__ import annotations

import re

import numpy as np
import pytest
from box_street import INTERVAL_NS, BoxStreet, pose
from diagnostic_msgs.msg import DiagnosticStatus
from node_harness import QUICK
from sensor_msgs.msg import PointCloud2, PointField
from synthetic_clouds import cloud_message, column, flow_columns, xyz_columns

from mnsf_ros.geometry.transforms import apply, mounted_at
from mnsf_ros.settings import LidarSettings

STREET = BoxStreet()
START_NS = 800_000 * 10**9
MOUNTS = (
    LidarSettings(x_m=1.5, z_m=1.0, yaw_deg=10.0),
    LidarSettings(x_m=-1.5, y_m=0.2, z_m=1.2, pitch_deg=5.0, yaw_deg=180.0),
)
PHASE_NS = 20_000_000  # of the second lidar
STEP_M = 0.5


@pytest.fixture(scope="module")
def two(run_node):
    parameters = QUICK | {"ground.remove": "true", "lidars.count": 2, "lidars.poses": "parameters"}
    # It would subscribe anew once it sees the publishers, and miss clouds until then.
    parameters["node.input_reliability"] = "reliable"
    # However slow the machine is.
    parameters["lidars.max_wait_s"] = 1.0
    for number, mount in enumerate(MOUNTS, start=1):
        parameters |= {f"lidar_{number}.{name}": value for name, value in vars(mount).items()}
    peer = run_node(parameters, name="/two")
    peer.rear = peer.node.create_publisher(PointCloud2, "/two/points_2", 50)
    peer.spin_until(
        lambda: peer.num_subscribers and peer.rear.get_subscription_count(), "both subscriptions"
    )
    return peer


def robot_pose(stamp_ns):
    return pose(STEP_M * (stamp_ns - START_NS) / INTERVAL_NS)


def half_street(index, lidar, *, drive=0, **options):
    """The half of the street on a lidar's side of the robot, in its own frame."""
    stamp_ns = START_NS + drive * 10**12 + index * INTERVAL_NS + lidar * PHASE_NS
    xyz = STREET.xyz(robot_pose(stamp_ns - drive * 10**12), seed=index)
    xyz = xyz[xyz[:, 0] > 0] if lidar == 0 else xyz[xyz[:, 0] <= 0]
    own = apply(np.linalg.inv(mounted_at(MOUNTS[lidar])), xyz).astype(np.float32)
    columns = {axis: np.ascontiguousarray(own[:, number]) for number, axis in enumerate("xyz")}
    columns["intensity"] = np.full(len(own), lidar + 7, np.float32)
    return cloud_message(columns, stamp_ns=stamp_ns, frame_id=f"lidar_{lidar}", **options)


def drive_on(peer, indices, drive, *, lidars=(0, 1), rear_clock_s=0):
    """Sends clouds and returns the flow of all but the first and the last sweep."""
    publishers = (peer.publish, peer.rear.publish)
    fronts = []
    for index in indices:
        clouds = [half_street(index, lidar, drive=drive) for lidar in lidars]
        clouds[-1].header.stamp.sec += rear_clock_s
        before = peer.count("sweeps_received")
        for lidar, cloud in zip(lidars, clouds, strict=True):
            publishers[lidar](cloud)
        peer.spin_until(lambda before=before: peer.count("sweeps_received") > before, "a sweep")
        # A machine that is slower than the clouds would drop a triplet.
        peer.wait_until_settled()
        fronts.append(clouds[0])
    return [peer.flow_of(cloud) for cloud in fronts[1:-1]]


def test_clouds_are_merged_in_the_frame_of_the_robot_with_their_own_times(two):
    (flow, *_) = drive_on(two, range(4), drive=0)
    assert flow.header.frame_id == "base_link"
    types = {field.name: field.datatype for field in flow.fields}
    assert list(types)[:6] == ["x", "y", "z", "intensity", "time", "lidar"]
    assert types["lidar"] == PointField.UINT8
    lidar = column(flow, "lidar").astype(int) - 1
    np.testing.assert_array_equal(column(flow, "intensity"), lidar + 7)
    np.testing.assert_allclose(column(flow, "time"), lidar * PHASE_NS / 1e9, atol=1e-6)
    # The street is where it was before it was cut in two.
    for number, phase_ns in ((0, 0), (1, PHASE_NS)):
        stamp_ns = START_NS + INTERVAL_NS + phase_ns
        wanted = STREET.xyz(robot_pose(stamp_ns), seed=1)
        wanted = wanted[wanted[:, 0] > 0] if number == 0 else wanted[wanted[:, 0] <= 0]
        np.testing.assert_allclose(xyz_columns(flow)[lidar == number], wanted, atol=1e-4)
    # What stands moves against the robot, before and behind it; the rear was seen later.
    motion = np.median(flow_columns(flow)[lidar == 0], axis=0)
    np.testing.assert_allclose(motion, (-STEP_M, 0, 0), atol=0.06)
    motion = np.median(flow_columns(flow)[lidar == 1], axis=0)
    np.testing.assert_allclose(motion, (-STEP_M, 0, 0), atol=0.06)
    assert not column(flow, "dynamic").any()
    assert two.status("input").level == DiagnosticStatus.OK


def test_lidar_that_fails_is_told_and_stops_nobody(two):
    drive_on(two, range(3), drive=1)
    before = two.count("clouds_of_lidar_2_missing")
    flows = drive_on(two, range(3, 8), drive=1, lidars=(0,))
    assert set(column(flows[-1], "lidar").tolist()) == {1}
    assert two.count("clouds_of_lidar_2_missing") == before + 5
    assert two.status("input").level == DiagnosticStatus.WARN
    assert two.status("input").message == "merged without /two/points_2"
    flows = drive_on(two, range(8, 13), drive=1)
    assert set(column(flows[-1], "lidar").tolist()) == {1, 2}
    two.wait_for_diagnostics()
    assert two.status("input").level == DiagnosticStatus.OK


def test_lidar_with_another_clock_is_named(two):
    drive_on(two, range(3), drive=2)
    drive_on(two, range(3, 6), drive=2, rear_clock_s=3600)
    message = two.status("input").message
    assert re.fullmatch(r"merged without /two/points_2 \(its stamps are \d+\.\d s ahead\)", message)
    assert two.count("clouds_of_lidar_2_of_another_time") > 0
