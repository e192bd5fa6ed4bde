"""The files for viewers show what the node publishes."""

from __future__ import annotations

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
