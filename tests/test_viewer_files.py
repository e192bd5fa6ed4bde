"""The files for viewers show what the node publishes."""

from __future__ import annotations

import json
import re
from pathlib import Path

from ruamel.yaml import YAML

ROOT = Path(__file__).parents[1]


def test_rviz_shows_what_the_node_publishes() -> None:
    content = (ROOT / "rviz" / "scene_flow.rviz").read_text()
    displays = YAML(typ="safe").load(content)["Visualization Manager"]["Displays"]
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
