# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tables as they are printed: names and figures are whole on a terminal of any width."""

import io
from collections.abc import Sequence

import pytest
from rich.console import Console

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.report.tables import errors_table
from mnsf_ros.report.text_table import TextTable

ERRORS = FlowErrors(0.0754, 0.85342, 0.9254, 0.328, 0.2861, 1000)
FIGURES = ["0.075", "85.3", "92.5", "32.8", "0.286"]


def printed(table: TextTable, width: int) -> list[str]:
    stream = io.StringIO()
    Console(file=stream, width=width).print(table)
    lines = stream.getvalue().splitlines()
    assert max(map(len, lines)) <= width
    return lines


def cells(lines: Sequence[str]) -> set[str]:
    rows = [line for line in lines if line.startswith("│")]
    return {cell.strip() for row in rows for cell in row.strip("│").split("│")}


@pytest.mark.parametrize("width", [28, 30, 40, 60, 80, 120])
def test_names_and_figures_are_whole(width: int) -> None:
    methods = ["mnsf", "ego-estimated", "nsfp-linear"]
    times_ms = dict.fromkeys(methods, 12345.0)
    table = errors_table(dict.fromkeys(methods, ERRORS), title="All points", times_ms=times_ms)
    lines = printed(table, width)
    assert cells(lines) == {*methods, *FIGURES, "12345"}
    for word in ("All", "EPE", "Outliers", "angle", "time"):
        assert word in "\n".join(lines)


@pytest.mark.parametrize(("width", "num_blocks"), [(120, 1), (80, 1), (60, 2)])
def test_what_finds_no_room_follows_below(width: int, num_blocks: int) -> None:
    names = ["(b) inversion and mean, no fusion network", "ego-estimated"]
    table = errors_table(
        dict.fromkeys(names, ERRORS), times_ms=dict.fromkeys(names, 12345.0), row_title="variant"
    )
    lines = printed(table, width)
    assert sum("variant" in line for line in lines) == num_blocks
    # Broken between words, if at all.
    said = " ".join(" ".join(line.split("│")[1].split()) for line in lines if line[:1] == "│")
    assert said.split() == " ".join(names).split() * num_blocks


def test_room_that_is_there_is_used() -> None:
    table = TextTable(["method", "moved points (m)", "unmoved (m)"], [["mnsf", "0.1", "0.2"]])
    assert "┃ method ┃ moved points (m) ┃ unmoved (m) ┃" in printed(table, 45)
    assert printed(TextTable(["name"], []), 20)[1] == "┃ name ┃"


def test_wide_letters_count_twice() -> None:
    table = TextTable(["method", "EPE (m)"], [["测" * 8, "0.1"]])
    stream = io.StringIO()
    Console(file=stream, width=30).print(table)
    assert "测" * 8 in stream.getvalue()


def test_name_that_is_longer_than_the_terminal_is_folded() -> None:
    name = "command:/home/somebody/programs/run_flot.py"
    lines = printed(TextTable(["method", "EPE (m)"], [[name, "0.075"]]), 30)
    assert "".join(line.split("│")[1].strip() for line in lines if line[0] == "│") == name
    assert "0.075" in cells(lines)
