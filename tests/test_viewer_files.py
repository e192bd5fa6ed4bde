# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The files for viewers show what the node publishes."""

from __future__ import annotations

import dataclasses
import json
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import pytest
from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]
# Displays of RViz 14 (Jazzy), and those of their properties that are used; RViz skips others
# without a word.
ALL_DISPLAYS = {"Class", "Name", "Enabled"}
RVIZ_DISPLAYS = {
    "Grid": {"Cell Size", "Plane Cell Count", "Color"},
    "PointCloud2": {
        "Topic",
        "Style",
        "Size (Pixels)",
        "Color Transformer",
        "Position Transformer",
    },
    "MarkerArray": {"Topic", "Namespaces"},
    "Odometry": {
        *("Topic", "Keep", "Position Tolerance", "Angle Tolerance", "Shape", "Covariance"),
    },
}


def rviz_displays() -> list[dict[str, Any]]:
    content = (ROOT / "rviz" / "scene_flow.rviz").read_text()
    return YAML(typ="safe").load(content)["Visualization Manager"]["Displays"]


def test_rviz_knows_the_displays_and_their_properties() -> None:
    for display in rviz_displays():
        package, _, kind = display["Class"].partition("/")
        assert package == "rviz_default_plugins"
        assert display.keys() <= ALL_DISPLAYS | RVIZ_DISPLAYS[kind], display["Name"]


def test_rviz_shows_what_the_node_publishes() -> None:
    displays = rviz_displays()
    shown = {display["Topic"]["Value"]: display for display in displays if "Topic" in display}
    assert shown.keys() == {
        f"/scene_flow/{name}" for name in ("flow", "flow/moving", "objects/markers", "ego_motion")
    }
    for topic in ("/scene_flow/flow", "/scene_flow/flow/moving"):
        assert shown[topic]["Color Transformer"] == "RGB8"


def test_foxglove_layout_shows_topics_of_the_node_and_of_the_view() -> None:
    layout = json.loads((ROOT / "mnsf_ros" / "view" / "foxglove_layout.json").read_text())
    panels = layout["configById"]
    assert set(re.findall(r'"((?:3D|Plot|Diagnostic)[^"]*)"', json.dumps(layout["layout"]))) == set(
        panels
    )
    topics = panels["3D!scene_flow"]["topics"]
    published = "".join(path.read_text() for path in (ROOT / "mnsf_ros").rglob("*.py"))
    for topic in topics:
        assert topic in published or topic.replace("/scene_flow/", "~/") in published
    for name in ("flow", "flow/moving", "flow/standing"):
        assert topics[f"/scene_flow/{name}"]["colorMode"] == "rgb"
        assert topics[f"/scene_flow/{name}"]["colorField"] == "rgb"
    for path in panels["Plot!latency"]["paths"]:
        assert re.fullmatch(
            r"/scene_flow/debug/(processing_time|pipeline_latency|cyclic_time)_ms\.data",
            path["value"],
        )
    assert panels["DiagnosticSummary!status"]["topicToRender"] == "/diagnostics"


def camel_case(name: str) -> str:
    first, *others = name.split("_")
    return first + "".join(word.title() for word in others)


def check_known(config: Mapping[str, Any], kind: type, *others: str) -> None:
    """All settings are fields of a class of Foxglove's SDK."""
    known = {camel_case(field.name) for field in dataclasses.fields(kind)}
    assert known
    assert config.keys() <= {*known, *others}


def test_foxglove_knows_the_settings_of_the_layout() -> None:
    """Foxglove drops unknown ones without a word; its SDK has the list."""
    foxglove = pytest.importorskip("foxglove.layouts")
    panels = json.loads((ROOT / "mnsf_ros" / "view" / "foxglove_layout.json").read_text())[
        "configById"
    ]
    scene, plot = panels["3D!scene_flow"], panels["Plot!latency"]
    check_known(scene, foxglove.ThreeDeeConfig)
    check_known(scene["cameraState"], foxglove.ThreeDeeCameraState)
    check_known(scene["scene"], foxglove.BaseRendererSceneSettings)
    check_known(scene["layers"]["grid"], foxglove.BaseRendererGridLayerSettings)
    for topic in scene["topics"].values():
        check_known(topic, foxglove.BaseRendererPointCloudTopicSettings)
    check_known(plot, foxglove.PlotConfig, "foxglovePanelTitle")
    for path in plot["paths"]:
        check_known(path, foxglove.PlotSeries)
    check_known(panels["DiagnosticSummary!status"], foxglove.DiagnosticsSummaryConfig)
