# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The frame of the benchmarks: verdicts, sections of a document, and scripts that can start."""

import math
import sys
from pathlib import Path

import numpy as np
import pytest

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
SCRIPTS = sorted(
    path.stem for path in BENCHMARKS.glob("*.py") if "__main__" in path.read_text("utf-8")
)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_explains_itself(load, monkeypatch, capsys, name):
    if name in ("cost", "live", "reliability"):
        pytest.importorskip("rclpy")
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        load(name).main()
    assert ended.value.code == 0
    assert f"benchmarks/{name}.py" in capsys.readouterr().out


def test_targets_are_met_missed_or_not_judged(load):
    target = load("frame").Target
    assert target("CPU", 0.5, 0.56, text="0.56 (74 ms)").row() == [
        *("CPU", "at most 0.5", "0.56 (74 ms)", "MISSED")
    ]
    assert target("found (%)", 97, 97.8, is_minimum=True).row() == [
        *("found (%)", "at least 97", "97.8", "met")
    ]
    assert target("CPU", 0.5, math.nan).verdict == ""


def test_results_replace_the_section_of_a_document(load, tmp_path, capsys):
    frame = load("frame")
    document = tmp_path / "performance.md"
    document.write_text("before\n<!-- begin x -->\nold\n<!-- end x -->\nafter\n")
    shown = frame.Table("Errors", ["", "EPE (m)"], [["online", "0.018"]])
    detail = frame.Table("Details", ["", "EPE (m)"], [["street", "0.009"]], is_detail=True)
    frame.publish("x", [shown, detail], document)
    text = (
        f"{frame.this_machine()}. Errors\n\n|  | EPE (m) |\n| :--- | ---: |\n| online | 0.018 |\n"
    )
    expected = f"before\n<!-- begin x -->\n{text}<!-- end x -->\nafter\n"
    assert document.read_text() == expected
    assert "street" in capsys.readouterr().out
    with pytest.raises(ValueError, match="begin y"):
        frame.replace_section(document, "y", "new")
    assert document.read_text() == expected


def test_a_simulated_drive_keeps_its_speed(load):
    drive = load("drives").simulated_drive(0, 12, rate_hz=20, num_beams=16, num_columns=36)
    sweeps = list(drive)
    stamps_ns = [item.sweep.stamp_ns for item in sweeps]
    np.testing.assert_array_equal(np.diff(stamps_ns), 10**9 // 20)
    places = np.stack([item.pose[:3, 3] for item in sweeps])
    assert np.linalg.norm(np.diff(places, axis=0), axis=1) * 20 == pytest.approx(8, abs=0.3)


def test_to_and_fro_passes_both_ends_once(load):
    to_and_fro = load("drives").to_and_fro
    assert to_and_fro("abcd") == list("abcdcb")
    assert to_and_fro([]) == []
