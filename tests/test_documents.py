# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Documents name what there is: links, settings, commands and their options, Python modules."""

from __future__ import annotations

import ast
import importlib
import re
import shlex
from pathlib import Path

import pytest

from mnsf_ros.cli.main import run
from mnsf_ros.settings import Settings

ROOT = Path(__file__).parents[1]
DOCUMENTS = (ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").glob("*.md")))


def anchors(path: Path) -> set[str]:
    """What a link into a document may name: its headings as GitHub spells them."""
    headings = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_links_of_documents_lead_somewhere(path: Path) -> None:
    for link in re.findall(r"\]\((?!https?:)([^)\[]+)\)", path.read_text()):
        file, _, anchor = link.partition("#")
        target = path.parent / file if file else path
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_documents_name_only_settings_that_are_there(path: Path) -> None:
    names = set(re.findall(r"(?<![\w.])([a-z_]+\.[a-z_]+)(?=[`:=\s])", path.read_text()))
    declared = set(Settings().to_mapping())
    groups = {name.partition(".")[0] for name in declared}
    modules = {"sweeps", "objects.py"}
    found = {name for name in names if name.split(".")[0] in groups - modules}
    assert {name for name in found - declared if not name.endswith((".py", ".md", "._"))} == set()


def commands(text: str) -> list[list[str]]:
    """The `mnsf` command lines in the code blocks of a document, as words."""
    blocks = re.findall(r"^```(?:bash)?\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    lines = [line for block in blocks for line in block.replace("\\\n", " ").splitlines()]
    starts = [re.sub(r"^(\w+='.*?' )?", "", line.partition(" #")[0]) for line in lines]
    return [shlex.split(line)[1:] for line in starts if line.startswith("mnsf ")]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_commands_of_documents_have_options_that_are_there(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for words in commands(path.read_text()):
        with pytest.raises(SystemExit) as ended:
            run([words[0], "--help"])
        assert ended.value.code == 0, words
        known = set(re.findall(r"--?[a-z][a-z-]*", capsys.readouterr().out))
        assert {word for word in words if re.match(r"--?[a-z]", word)} <= known, words


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: str(path.relative_to(ROOT)))
def test_python_of_documents_imports_what_is_there(path: Path) -> None:
    for code in re.findall(r"^```python\n(.*?)^```", path.read_text(), re.MULTILINE | re.DOTALL):
        for node in ast.walk(ast.parse(code)):
            if isinstance(node, ast.ImportFrom) and str(node.module).startswith(("mnsf_", "msg_")):
                module = importlib.import_module(str(node.module))
                assert [name.name for name in node.names if not hasattr(module, name.name)] == []
