# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The node's process: transport of large clouds, memory, and an end where a library hangs."""

import os
import subprocess
import sys
import time
from xml.etree import ElementTree

import numpy as np
import pytest
from moving_boxes import surfaces
from node_harness import PREPARED
from synthetic_clouds import ADDED_BYTES, xyz_message

from mnsf_ros.errors import SettingsError
from mnsf_ros.node import environment
from mnsf_ros.node.environment import TRANSPORT_PROFILE, UDP_PROFILE

_PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
_NEWER_PROFILE = "FASTDDS_DEFAULT_PROFILES_FILE"
_THREADS = {"OMP_WAIT_POLICY": "ACTIVE", "OPENBLAS_NUM_THREADS": "2"}
_DDS = "{http://www.eprosima.com}"
# A cloud that has not come by then is lost.
_LOST_S = 5.0
_NEEDS_PROC = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")


@pytest.mark.parametrize(
    ("given", "is_set"),
    [
        ({}, True),
        ({_PROFILE: "", _NEWER_PROFILE: ""}, True),
        ({_PROFILE: str(TRANSPORT_PROFILE)}, True),
        ({_PROFILE: "/my/profile.xml", **_THREADS}, False),
        ({_NEWER_PROFILE: "/my/profile.xml", **_THREADS}, False),
    ],
)
@pytest.mark.parametrize("holds_clouds", [True, False])
def test_variables_are_set_unless_the_user_has_set_them(monkeypatch, given, is_set, holds_clouds):
    monkeypatch.setattr(environment, "sockets_hold_clouds", lambda *_: holds_clouds)
    found = dict(given)
    environment.prepare_environment(found, is_node=True)
    profile = UDP_PROFILE if holds_clouds else TRANSPORT_PROFILE
    own = {_PROFILE: str(profile), "RMW_FASTRTPS_USE_QOS_FROM_XML": "1"}
    own |= {"OMP_WAIT_POLICY": "PASSIVE", "OPENBLAS_NUM_THREADS": "1"}
    assert found == (given | own if is_set else given)


@pytest.mark.parametrize("domain", ["abc", "233", "-1", "1.5", " 5", "9" * 20])
def test_a_domain_that_ros_does_not_have_is_refused(domain):
    found = {"ROS_DOMAIN_ID": domain}
    with pytest.raises(SettingsError, match=r"expected a whole number from 0 to 232"):
        environment.prepare_environment(found)
    for known in ("", "0", "007", "232"):
        environment.prepare_environment(found | {"ROS_DOMAIN_ID": known})


@pytest.mark.parametrize("words", ["cli doctor /x", "cli play .", "cli view", "node"])
def test_node_and_commands_refuse_a_domain_in_one_line(words):
    module, *arguments = words.split()
    done = subprocess.run(
        [sys.executable, "-m", f"mnsf_ros.{module}", *arguments],
        env=os.environ | {"ROS_DOMAIN_ID": "abc"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert ": ROS_DOMAIN_ID is 'abc', expected a whole number from 0 to 232: " in line


def test_advice_on_lost_clouds_names_what_this_machine_lacks(monkeypatch):
    for holds_clouds in (True, False):
        monkeypatch.setattr(environment, "sockets_hold_clouds", lambda _, holds=holds_clouds: holds)
        advice = environment.advice_on_lost_clouds()
        assert f"{_PROFILE}={TRANSPORT_PROFILE}" in advice
        assert ("net.core.rmem_max" in advice) is not holds_clouds


def test_profiles_differ_only_in_the_reception():
    driver, node = (ElementTree.parse(path).getroot() for path in (TRANSPORT_PROFILE, UDP_PROFILE))
    (rtps,) = node.iter(f"{_DDS}rtps")
    rtps.remove(rtps.find(f"{_DDS}defaultUnicastLocatorList"))
    for root in (driver, node):
        for item in root.iter(f"{_DDS}receiveBufferSize"):
            item.text = ""
    driver_texts, node_texts = (
        [(item.tag, (item.text or "").strip()) for item in root.iter()] for root in (driver, node)
    )
    assert driver_texts == node_texts


# A lidar driver that knows nothing of this package.
_DRIVER = """
import sys
import time
import rclpy
from rclpy.qos import qos_profile_sensor_data
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

rclpy.init()
node = rclpy.create_node("driver")
publisher = node.create_publisher(PointCloud2, sys.argv[1], qos_profile_sensor_data)
while not publisher.get_subscription_count():
    time.sleep(0.01)
cloud = serialize_message(PointCloud2(data=bytes(2_000_000)))
while True:
    time.sleep(0.05)
    publisher.publish(cloud)
"""


@pytest.mark.slow
@pytest.mark.skipif(not environment.sockets_hold_clouds(), reason="net.core.rmem_max is too small")
def test_large_clouds_of_a_driver_with_the_default_transport_arrive(resting_peer):
    peer, losses = resting_peer, ("clouds_missed", "sweeps_lost_in_transport")
    peer.stop_advertising()
    before, num_lost = peer.num_clouds, sum(map(peer.count, losses))
    usual = {name: value for name, value in os.environ.items() if name not in PREPARED}
    driver = subprocess.Popen([sys.executable, "-c", _DRIVER, peer.points_topic], env=usual)
    try:
        peer.spin_until(lambda: peer.num_clouds >= before + 30, "thirty clouds")
    finally:
        driver.terminate()
        driver.wait()
    assert sum(map(peer.count, losses)) - num_lost < 10


def large_sweep(index, drive):
    """2 MB: 120,000 points of 16 bytes, most of them ground far below the boxes."""
    ground = np.random.default_rng(1).uniform(-60, 60, (118_800, 3))
    ground[:, 2] = -50
    xyz = np.vstack([surfaces(index), ground]).astype(np.float32)
    return xyz_message(xyz, stamp_ns=drive.stamp_ns(index))


def test_large_clouds_arrive_best_effort_and_so_does_their_flow(resting_peer, drive):
    peer = resting_peer
    peer.advertise(reliable=False)
    peer.wait_for_node()
    peer.flows.clear()
    peer.watch(reliable=False)
    num_sent, before, flows_before = 0, peer.count("sweeps_received"), peer.count("flows_out")
    while num_sent < 20 or len(peer.flows) < 3:
        received = peer.count("sweeps_received")
        peer.publish(large_sweep(num_sent, drive))
        num_sent += 1
        # As fast as the node takes them, however slow the machine is.
        give_up = time.monotonic() + _LOST_S
        while peer.count("sweeps_received") == received and time.monotonic() < give_up:
            peer.spin_for(0.02)
        assert num_sent < 100
    # The default transport loses most of them.
    assert peer.count("sweeps_received") - before >= 0.7 * num_sent
    assert len(peer.flows) >= 0.5 * (peer.count("flows_out") - flows_before)
    assert {len(flow.data) for flow in peer.flows.values()} == {120_000 * (16 + ADDED_BYTES)}


_RESIDENT = """
def resident_mb():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith("RssAnon"))
"""

# Blocks below and above the size that malloc maps by itself, every other one freed last.
_RETURNED = """
import numpy as np
from mnsf_ros.node.environment import keep_memory, return_memory
keep_memory()
before_mb = resident_mb()
blocks = [np.ones(size, np.uint8) for size in (4_000_000, 40_000, 18_000_000) * 10]
kept = blocks[1::3]
del blocks
left_mb = resident_mb()
return_memory()
print(left_mb - before_mb, resident_mb() - before_mb)
"""

# The same of what ROS keeps of a message.
_RETURNED_BY_ROS = """
from mnsf_ros.node.environment import prepare_environment, return_memory
prepare_environment()
import rclpy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2

def publish(num_bytes):
    publisher.publish(serialize_message(PointCloud2(data=bytes(num_bytes))))

rclpy.init()
node = rclpy.create_node("sends_a_large_cloud")
publisher = node.create_publisher(PointCloud2, "~/large", 1)
publish(1_000_000)
before_mb = resident_mb()
for num_bytes in (80_000_000, 1_000_000, 1_000_000):
    publish(num_bytes)
return_memory()
print(resident_mb() - before_mb)
"""


def printed_mb(script):
    result = subprocess.run(
        [sys.executable, "-c", _RESIDENT + script], capture_output=True, text=True, check=True
    )
    return list(map(float, result.stdout.split()))


@_NEEDS_PROC
def test_memory_is_kept_from_sweep_to_sweep_and_returned_now_and_then():
    kept_mb, returned_mb = printed_mb(_RETURNED)
    assert kept_mb > 100
    assert returned_mb < 20


@pytest.mark.slow
@_NEEDS_PROC
def test_a_publisher_does_not_keep_the_memory_of_its_largest_message():
    (kept_mb,) = printed_mb(_RETURNED_BY_ROS)
    assert kept_mb < 20


# The regular expression computes for ever, and holds the interpreter's lock.
_HANGS = """
import re
from mnsf_ros.node.environment import leaving_ros
with leaving_ros(0.2):
    pass
with leaving_ros(0.2):
    re.match("(a+)+$", "a" * 99 + "b")
"""


@pytest.mark.parametrize("preamble", ["", "import sys; sys.__stderr__ = None"])
def test_leaving_ros_ends_the_process_where_it_hangs(preamble):
    command = [sys.executable, "-c", preamble + _HANGS]
    ended = subprocess.run(command, capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 1
    assert ("most recent call first" in ended.stderr) == (not preamble)
