# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
from __future__ import annotations

import dataclasses
import re
from pathlib import Path

from mnsf_ros.recording import bag_topics
from mnsf_ros.recording.flow_truth import SurfaceClass
from mnsf_ros.simulation.scenarios import STAGES
from mnsf_ros.simulation.settings import SCENARIOS, SimulationSettings

TEXT = (Path(__file__).parents[2] / "docs" / "recordings.md").read_text(encoding="utf-8")


def test_kinds_of_surface_are_documented():
    table = dict(re.findall(r"^\| (\d+) \| ([a-z ]+) \|$", TEXT, re.MULTILINE))
    expected = {str(int(c)): c.name.lower().replace("_", " ") for c in SurfaceClass}
    assert table == {"0": "unknown", **expected}


def test_settings_are_documented_with_their_defaults():
    table = dict(re.findall(r"^\| `(\w+)` \| ([\d.]+|street) \|", TEXT, re.MULTILINE))
    defaults = {field.name: field.default for field in dataclasses.fields(SimulationSettings)}
    texts = {
        name: value if isinstance(value, str) else f"{value:g}" for name, value in defaults.items()
    }
    assert table == texts


def test_topics_and_frames_are_documented():
    for name, value in vars(bag_topics).items():
        if name.endswith(("_TOPIC", "_FRAME")):
            assert f"`{value}`" in TEXT, name


def test_every_scenario_is_documented():
    for name in SCENARIOS:
        assert f"`{name}`" in TEXT, name
    for name, stage in STAGES.items():
        assert f"| `{name}` | {stage.text} |" in TEXT
