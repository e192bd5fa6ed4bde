# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tables of finished cells: on terminals of any width, as Markdown and as LaTeX."""

import io
import math
import re

import pandas as pd
import pytest
from rich.console import Console

from mnsf_ros.report.tables import errors_table
from mnsf_ros.report.text_table import TextTable, markdown_code

FNSF = {
    "epe_m": 0.0754,
    "acc5": 0.85342,
    "acc10": 0.9254,
    "outliers": 0.328,
    "angle_error_rad": 0.2861,
}
CELLS = ["0.075", "85.3", "92.5", "32.8", "0.286"]


def errors(**lines):
    return pd.DataFrame.from_dict(lines, orient="index")


def printed(table, width=100):
    stream = io.StringIO()
    Console(file=stream, width=width).print(table)
    return stream.getvalue()


def test_errors_in_the_order_of_the_paper_and_in_percent():
    table = errors_table(errors(FNSF=FNSF, nothing=dict.fromkeys(FNSF, math.nan)))
    titles = ["EPE (m)", "Acc5 (%)", "Acc10 (%)", "Outliers (%)", "angle (rad)"]
    assert table.header == ["method", *titles]
    assert table.rows == [["FNSF", *CELLS], ["nothing", *"-----"]]
    timed = errors(FNSF=FNSF | {"time_ms": 608.6}, NSFP=FNSF | {"time_ms": math.nan})
    table = errors_table(timed, row_title="run")
    assert (table.header[0], table.header[-1]) == ("run", "time (ms)")
    assert [row[-1] for row in table.rows] == ["609", "-"]


def test_markdown():
    table = TextTable(("name", "value"), [("|e| > 1\nor so", "1"), ("b", "2")], "Two things")
    rows = "| name | value |\n| :--- | ---: |\n| \\|e\\| > 1 or so | 1 |\n| b | 2 |\n"
    assert table.markdown() == f"Two things\n\n{rows}"
    assert TextTable(("name",), []).markdown() == "| name |\n| :--- |\n"


def test_markdown_has_no_tags_and_code_no_end():
    table = TextTable(("<script>", "\x1b[31m"), [("<b>&", "<i>")], "<img src=x>")
    text = table.markdown()
    assert not set(text) & set("<\x1b")
    assert text.startswith("&lt;img src=x>")
    assert markdown_code("a `b`` <c>") == "``` a `b`` <c> ```"
    assert markdown_code("a b") == "`a b`"


def test_latex():
    table = TextTable(("method_a & b", "EPE (m)"), [["50 % {x}", "0.1"], ["a\\b", "-"]], "A_1")
    lines = table.latex().splitlines()
    assert lines[:3] == [r"\begin{table}", r"\caption{A\_1}", r"\begin{tabular}{lr}"]
    assert lines[4] == r"method\_a \& b & EPE (m) \\"
    assert lines[6] == r"50 \% \{x\} & 0.1 \\"
    assert [line for line in lines if "rule" in line] == [r"\toprule", r"\midrule", r"\bottomrule"]


@pytest.mark.parametrize(("width", "num_blocks"), [(120, 1), (80, 1), (60, 2), (30, 6)])
def test_terminal_shows_all_cells_and_columns_without_room_below(width, num_blocks):
    names = ["mnsf", "ego-estimated"]
    table = errors_table(
        errors(**{name: FNSF | {"time_ms": 12345} for name in names}), "All points"
    )
    text = printed(table, width)
    assert max(map(len, text.splitlines())) <= width
    assert text.startswith("All points\n")
    for cell in (*CELLS, "12345", *names):
        assert cell in text
    assert len(re.findall("^ego-estimated", text, re.MULTILINE)) == num_blocks


def test_terminal_does_not_take_cells_for_markup():
    table = TextTable(
        ("name", "[red]x"), [("[a] without", "[/b]"), ("测" * 8, "0")], title="[bold]"
    )
    for cell in ("[red]x", "[a] without", "[/b]", "[bold]", "测" * 8):
        assert cell in printed(table)
    assert "after" in printed(TextTable(["name", "after", "after"], [["a", "1", "2"]]))
