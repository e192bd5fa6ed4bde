# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The files for RViz and Foxglove show topics of the node, each with a type that is shown so."""

from __future__ import annotations

import json
import re
from pathlib import Path

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[2]
TYPES = {
    "rviz_default_plugins/PointCloud2": "sensor_msgs/msg/PointCloud2",
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Odometry": "nav_msgs/msg/Odometry",
}


@pytest.fixture
def types_of(peer):
    """Topics of the node as the files name them, with their types."""

    def found():
        return dict(peer.names_and_types("get_publisher_names_and_types_by_node"))

    # The publisher that the node makes last.
    peer.spin_until(lambda: "/diagnostics" in found(), "the topics of the node")
    return {name.replace("/quick/", "/scene_flow/"): types for name, types in found().items()}


def test_displays_of_rviz(types_of):
    content = (ROOT / "rviz" / "scene_flow.rviz").read_text()
    displays = YAML(typ="safe").load(content)["Visualization Manager"]["Displays"]
    shown = [display for display in displays if "Topic" in display]
    assert len(shown) == 4
    for display in shown:
        assert types_of[display["Topic"]["Value"]] == [TYPES[display["Class"]]]


def test_panels_of_foxglove(types_of):
    layout = json.loads((ROOT / "mnsf_ros" / "view" / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    clouds = [name for name in panels["3D!scene_flow"]["topics"] if "/flow/" in f"{name}/"]
    assert {str(types_of[name]) for name in clouds} == {"['sensor_msgs/msg/PointCloud2']"}
    for path in panels["Plot!latency"]["paths"]:
        assert types_of[re.sub(r"\.data$", "", path["value"])] == ["std_msgs/msg/Float64"]
    status = panels["DiagnosticSummary!status"]["topicToRender"]
    assert types_of[status] == ["diagnostic_msgs/msg/DiagnosticArray"]
