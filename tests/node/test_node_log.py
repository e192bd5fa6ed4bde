# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Faults that go on are logged at a low rate; the greeting names the settings."""

from mnsf_ros.node.node_log import FaultLog, greeting
from mnsf_ros.presets import preset
from mnsf_ros.settings import Settings


def test_each_kind_of_fault_is_logged_once_at_first(ros, capfd):
    faults = FaultLog("of_a_test")
    for number in range(100):
        faults.warn("undecodable", f"cloud {number}")
        faults.warn("empty", "no point")
        faults.unexpected("callback", ValueError("no time"))
    suffix = "(at most every 10 min, counted in /diagnostics)"
    lines = [line.split("[of_a_test]: ") for line in capfd.readouterr().err.splitlines()]
    error = "callback: refused by ROS in : ValueError: no time"
    assert [text for _, text in lines] == [
        f"{text} {suffix}" for text in ("cloud 0", "no point", error)
    ]
    assert [start[1:6].strip("] ") for start, _ in lines] == ["WARN", "WARN", "ERROR"]


def test_greeting_names_the_changes_to_a_preset():
    start = "preset online, method online, device auto, 2 threads, ego motion from "
    settings = Settings().changed({"compute.num_threads": 2})
    assert greeting(settings) == f"{start}registration"
    changed = settings.changed({"ego_motion.source": "odometry", "crop.max_range_m": 60})
    assert greeting(changed).startswith("preset online but for crop.max_range_m, ego_motion.source")
    paper = preset("paper").changed({"compute.num_threads": 1})
    assert greeting(paper).startswith("preset paper, method mnsf, device auto, 1 thread, ")
