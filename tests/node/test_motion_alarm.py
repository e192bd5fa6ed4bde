# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The program of docs/recipes.md that warns of what moves."""

import re
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest
from node_harness import PATIENCE_S
from sensor_msgs.msg import PointCloud2
from std_msgs.msg import Header
from synthetic_clouds import tracked

from mnsf_ros.node.object_messages import objects_cloud

ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture
def alarm():
    text = (ROOT / "docs" / "recipes.md").read_text()
    (code,) = re.findall(r"^```python\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    process = subprocess.Popen(
        [sys.executable, "-c", code], cwd=ROOT, stderr=subprocess.PIPE, text=True
    )
    yield process
    process.kill()
    process.communicate()


def test_what_is_near_is_said_and_what_is_far_is_not(ros, alarm):
    import rclpy

    node = rclpy.create_node("objects_of_a_test")
    publisher = node.create_publisher(PointCloud2, "/scene_flow/objects", 1)
    lines: list[str] = []
    reader = threading.Thread(target=lambda: lines.append(alarm.stderr.readline()), daemon=True)
    reader.start()
    objects = (
        tracked(7, center=np.array([30.0, 0.0, 0.0])),
        tracked(8, center=np.array([4.0, -2.0, 0.0])),
    )
    deadline_s = time.monotonic() + PATIENCE_S
    while not lines and time.monotonic() < deadline_s:
        publisher.publish(objects_cloud(Header(frame_id="lidar"), objects))
        reader.join(0.1)
    node.destroy_node()
    assert "object 8 moves at x 4.0, y -2.0 m" in lines[0]
