# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""docs/troubleshooting.md explains every message and level of `/diagnostics`."""

from __future__ import annotations

import ast
import inspect
import math
import re
from pathlib import Path

import pytest

from mnsf_ros.node import diagnostics, scene_flow_node
from mnsf_ros.online import watches
from mnsf_ros.online.watches import busy_text

PAGE = (Path(__file__).parents[2] / "docs" / "troubleshooting.md").read_text()
ROWS = re.findall(r"^\| (OK|WARN|ERROR|STALE) \| (.+?) \|", PAGE, re.MULTILINE)


def texts(node: ast.expr) -> list[str]:
    """The longest fixed part of each text that an expression can be."""
    if isinstance(node, ast.IfExp):
        return [*texts(node.body), *texts(node.orelse)]
    if isinstance(node, ast.JoinedStr):
        node = max(
            (part for part in node.values if isinstance(part, ast.Constant)),
            key=lambda part: len(part.value),
        )
    is_text = isinstance(node, ast.Constant) and isinstance(node.value, str)
    return [re.sub(r" ?\(.*", "", node.value).strip(" :;,")] if is_text else []


def messages() -> list[tuple[str, str]]:
    """Level and text of each message in the code; the level is empty where it is set elsewhere."""
    found = []
    for node in ast.walk(ast.parse(inspect.getsource(diagnostics))):
        if isinstance(node, ast.Assign) and isinstance(node.value, ast.Tuple):
            level, message = node.value.elts[0], node.value.elts[-1]
            if isinstance(level, ast.Attribute) and level.attr in ("OK", "WARN", "ERROR", "STALE"):
                found += [(level.attr, text) for text in texts(message)]
        elif isinstance(node, ast.FunctionDef):
            level = {"_flow_warning": "WARN", "_activity": "OK", "_failures": "ERROR"}
            if node.name in level:
                found += [
                    (level[node.name], text)
                    for inner in ast.walk(node)
                    if isinstance(inner, ast.Return) and inner.value
                    for text in texts(inner.value)
                ]
    return [(level, text) for level, text in found if text]


def test_messages_are_found_in_the_code():
    assert {level for level, _ in messages()} == {"OK", "WARN", "ERROR", "STALE"}
    assert len(messages()) > 10


@pytest.mark.parametrize(("level", "text"), messages())
def test_each_message_has_a_row_with_its_level(level, text):
    assert any(level == row_level and text in shown for row_level, shown in ROWS), (level, text)


@pytest.mark.parametrize(("counter", "reason"), watches._REASONS.items())
def test_each_reason_for_no_flow_has_a_row(counter, reason):
    assert f"| `{reason}` | `{counter}` |" in PAGE


def test_a_busy_computer_is_in_the_table():
    start = busy_text(18, 60, math.nan, math.nan).partition(" (")[0]
    assert any(level == "WARN" and start in shown for level, shown in ROWS)


@pytest.mark.parametrize("reason", [scene_flow_node._DISABLED, scene_flow_node._INACTIVE])
def test_a_node_that_ignores_clouds_is_in_the_table(reason):
    assert ("OK", f"`{reason}`") in ROWS
