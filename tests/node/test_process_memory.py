# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Memory that is not needed goes back to the system."""

from __future__ import annotations

import subprocess
import sys

import pytest

# Blocks below and above the size that malloc maps by itself, every other one freed last.
_RETURNED = """
import numpy as np
from mnsf_ros.node.process_memory import keep_memory, return_memory

def resident_mb():
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith("VmRSS"))

keep_memory({})
before_mb = resident_mb()
blocks = [np.ones(size, np.uint8) for size in (4_000_000, 40_000, 24_000_000) * 10]
kept = blocks[1::3]
del blocks
left_mb = resident_mb()
return_memory()
print(left_mb - before_mb, resident_mb() - before_mb)
"""

# A timer of the node does it.
_TIMER = """
import rclpy
from mnsf_ros.node.process_memory import RETURN_PERIOD_S
from mnsf_ros.node.scene_flow_node import SceneFlowNode

rclpy.init()
node = SceneFlowNode()
(timer,) = (one for one in node.timers if one.timer_period_ns == RETURN_PERIOD_S * 1e9)
"""

# The same of what ROS keeps of a message.
_RETURNED_BY_ROS = """
from mnsf_ros.node.environment import prepare_environment
prepare_environment()
import rclpy
from rclpy.serialization import serialize_message
from sensor_msgs.msg import PointCloud2
from mnsf_ros.node.process_memory import return_memory

def resident_mb():
    return_memory()
    lines = open("/proc/self/status").read().splitlines()
    return next(int(line.split()[1]) / 1e3 for line in lines if line.startswith("RssAnon"))

def publish(num_bytes):
    publisher.publish(serialize_message(PointCloud2(data=bytes(num_bytes))))

rclpy.init()
node = rclpy.create_node("sends_a_large_cloud")
publisher = node.create_publisher(PointCloud2, "~/large", 1)
publish(1_000_000)
before_mb = resident_mb()
for num_bytes in (80_000_000, 1_000_000, 1_000_000):
    publish(num_bytes)
print(resident_mb() - before_mb)
"""


def printed_mb(script):
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True
    )
    return list(map(float, result.stdout.split()))


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
@pytest.mark.parametrize(
    "script", [_RETURNED, _TIMER + _RETURNED.replace("return_memory()", "timer.callback()")]
)
def test_the_process_keeps_little_of_what_it_freed(ros, script):
    kept_mb, returned_mb = printed_mb(script)
    assert kept_mb > 100
    assert returned_mb < 20


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="needs /proc")
def test_a_publisher_does_not_keep_the_memory_of_its_largest_message():
    (kept_mb,) = printed_mb(_RETURNED_BY_ROS)
    assert kept_mb < 20
