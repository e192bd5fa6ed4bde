# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The files for RViz, Foxglove and SROS 2 name the topics and services of the node."""

import json
from pathlib import Path
from xml.etree import ElementTree

import pytest
from ruamel.yaml import YAML

from mnsf_ros.settings import declared_setting
from mnsf_ros.sweeps_io.predicted_ground import predicted_columns

ROOT = Path(__file__).parents[2]

RVIZ_DISPLAYS = {
    "rviz_default_plugins/PointCloud2": "sensor_msgs/msg/PointCloud2",
    "rviz_default_plugins/MarkerArray": "visualization_msgs/msg/MarkerArray",
    "rviz_default_plugins/Odometry": "nav_msgs/msg/Odometry",
}

MOST_LIDARS = int(declared_setting("lidars.count").maximum)
# With several lidars, use_sim_time, tf2_ros, the packages of other planners, odometry, and with a
# life cycle.
OPTIONAL = {
    "subscribe": {
        *("/clock", "/tf", "/tf_static", "~/odometry"),
        *(f"~/points_{number}" for number in range(2, MOST_LIDARS + 1)),
    },
    "publish": {
        "~/objects/autoware",
        "~/objects/autoware/detected",
        "~/objects/detections",
        "~/objects/nav2",
        "~/transition_event",
        "/tf",
    },
    "reply": {
        *("~/change_state", "~/get_state", "~/get_available_states"),
        *("~/get_available_transitions", "~/get_transition_graph"),
    },
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
    shown = {display["Topic"]["Value"]: display for display in displays if "Topic" in display}
    assert shown.keys() == {
        f"/scene_flow/{name}"
        for name in ("flow", "flow/moving", "predicted", "objects/markers", "ego_motion")
    }
    for topic, display in shown.items():
        assert types_of[topic] == [RVIZ_DISPLAYS[display["Class"]]]


def test_layout_of_foxglove(types_of):
    layout = json.loads((ROOT / "config" / "foxglove.json").read_text())
    panels, places = layout["configById"], [layout["layout"]]
    while any(isinstance(place, dict) for place in places):
        places = [
            part
            for place in places
            for part in ([place] if isinstance(place, str) else [place["first"], place["second"]])
        ]
    assert sorted(places) == sorted(panels)
    assert {types_of[topic][0] for topic in panels["3D!flow"]["topics"]} == {
        "sensor_msgs/msg/PointCloud2",
        "visualization_msgs/msg/MarkerArray",
    }
    colored = panels["3D!flow"]["topics"]["/scene_flow/predicted"]["colorField"]
    assert colored in predicted_columns([], 1.0)
    for name in ("Plot!objects", "Plot!latency"):
        for path in panels[name]["paths"]:
            topic, field = path["value"].split(".")
            assert field in ("width", "data")
            assert topic in types_of
    assert panels["DiagnosticSummary!state"]["topicToRender"] in types_of


def allowed(rule):
    """Names of topics or services that a rule of the security policy allows."""
    policy = ElementTree.parse(ROOT / "config" / "security_policy.xml").getroot()
    profile = policy.find("./enclaves/enclave/profiles/profile")
    return {item.text for one in profile if one.get(rule) == "ALLOW" for item in one}


@pytest.mark.parametrize(
    ("rule", "names_of"),
    [
        ("subscribe", "get_subscriber_names_and_types_by_node"),
        ("publish", "get_publisher_names_and_types_by_node"),
        ("reply", "get_service_names_and_types_by_node"),
        ("request", "get_client_names_and_types_by_node"),
    ],
)
def test_the_security_policy_allows_the_names_of_the_node(peer, rule, names_of):
    def found():
        names = {name for name, _ in peer.names_and_types(names_of)}
        return {name.replace("/quick/", "~/", 1) for name in names}

    optional = OPTIONAL.get(rule, set())
    peer.spin_until(lambda: allowed(rule) - optional <= found(), "all that is allowed")
    assert found() <= allowed(rule)
    assert optional <= allowed(rule)
    assert not [name for name in allowed(rule) if "*" in name]
