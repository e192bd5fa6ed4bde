# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tables: what is in the cells, and that no text of a cell is taken for markup."""

from __future__ import annotations

import io
import math
import re

import pytest
from rich.console import Console

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.report.tables import errors_table
from mnsf_ros.report.text_table import TextTable, format_number, format_percent

FNSF = FlowErrors(0.0754, 0.85342, 0.9254, 0.328, 0.2861, 1000)
EMPTY = FlowErrors(math.nan, math.nan, math.nan, math.nan, math.nan, 0)


def printed(table):
    stream = io.StringIO()
    Console(file=stream, width=100).print(table)
    return stream.getvalue()


def test_errors_in_the_order_of_the_paper_and_in_percent():
    table = errors_table({"FNSF": FNSF, "nothing": EMPTY})
    assert table.header == [
        "method",
        "EPE (m)",
        "Acc5 (%)",
        "Acc10 (%)",
        "Outliers (%)",
        "angle (rad)",
    ]
    assert table.rows == [
        ["FNSF", "0.075", "85.3", "92.5", "32.8", "0.286"],
        ["nothing", "-", "-", "-", "-", "-"],
    ]


def test_times_are_a_last_column():
    table = errors_table(
        {"FNSF": FNSF, "MNSF": FNSF, "NSFP": FNSF},
        row_title="run",
        times_ms={"FNSF": 608.6, "NSFP": math.nan},
    )
    assert (table.header[0], table.header[-1]) == ("run", "time (ms)")
    assert [row[-1] for row in table.rows] == ["609", "-", "-"]


def test_markdown():
    table = TextTable(("name", "value"), [("a", "1"), ("b", "2")], title="Two things")
    assert table.markdown() == (
        "Two things\n\n| name | value |\n| :--- | ---: |\n| a | 1 |\n| b | 2 |\n"
    )
    assert TextTable(("name",), []).markdown() == "| name |\n| :--- |\n"


def test_markdown_keeps_cells_in_their_column():
    table = TextTable(("name", "value"), [("|e| > 1\nor so", "1")])
    assert table.markdown().splitlines()[2] == r"| \|e\| > 1 or so | 1 |"


def test_terminal_shows_all_cells():
    text = printed(errors_table({"FNSF": FNSF}, title="mean over 2 examples"))
    for cell in ("mean over 2 examples", "EPE (m)", "Acc10 (%)", "FNSF", "0.075", "0.286"):
        assert cell in text


def test_terminal_does_not_take_cells_for_markup():
    text = printed(TextTable(("name", "[red]x"), [("[a] without", "[/b]")], title="[bold]"))
    for cell in ("[red]x", "[a] without", "[/b]", "[bold]"):
        assert cell in text


def test_rows_of_another_length_are_refused():
    text = "row 2 of the table has 1 cells ('b',), expected 2: ('name', 'value')"
    with pytest.raises(EvaluationError, match=f"^{re.escape(text)}$"):
        TextTable(("name", "value"), [("a", "1"), ("b",)])


def test_numbers():
    assert format_number(1234.5678, 2) == "1234.57"
    assert format_number(0.4, 0) == "0"
    assert format_number(math.nan, 2) == "-"
    assert format_percent(0.12345) == "12.3"
    assert format_percent(1.0, 0) == "100"
    assert format_percent(math.nan) == "-"


def test_columns_that_find_no_room_follow_under_the_same_title():
    table = TextTable(["name", *(f"column{n}" for n in range(12))], [["a", *"b" * 12]], "A title")
    text = printed(table)
    assert text.count("A title") == 2
    assert text.count("A title (continued)") == 1
