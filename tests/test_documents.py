# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Documents name what there is: links, files, settings, options; their Python examples run."""

import re
import shlex
from pathlib import Path

import numpy as np
import pytest

from mnsf_ros.cli.main import run
from mnsf_ros.settings import Settings

ROOT = Path(__file__).parents[1]
PAGES = ("README.md", "CONTRIBUTING.md", "QUALITY_DECLARATION.md")
DOCUMENTS = (*(ROOT / name for name in PAGES), *sorted((ROOT / "docs").glob("*.md")))
SOURCES = ("mnsf_ros", "msg_utils", "benchmarks", "config", "launch")


def blocks(path: Path, language: str) -> list[str]:
    """The code blocks of a document."""
    pattern = rf"^```(?:{language})\n(.*?)^```"
    return re.findall(pattern, path.read_text(), re.MULTILINE | re.DOTALL)


def anchors(path: Path) -> set[str]:
    """The headings of a document as GitHub spells them in links."""
    headings = re.findall(r"^#+ (.+)$", path.read_text(), re.MULTILINE)
    return {re.sub(r"[^\w -]", "", heading).lower().replace(" ", "-") for heading in headings}


def commands(path: Path) -> list[list[str]]:
    """The `mnsf` command lines in the code blocks of a document, as words."""
    text = "\n".join(blocks(path, "|bash")).replace("\\\n", " ")
    starts = [re.sub(r"^(\w+='.*?' )?", "", line.partition(" #")[0]) for line in text.splitlines()]
    lines = [line.removeprefix(".venv/bin/") for line in starts]
    return [shlex.split(line)[1:] for line in lines if line.startswith("mnsf ")]


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_links_files_and_settings_are_there(path):
    text = path.read_text()
    for link in re.findall(r"\]\((?!https?:)([^)\[]+)\)", text):
        file, _, anchor = link.partition("#")
        target = path.parent / file if file else path
        assert target.exists(), link
        assert not anchor or anchor in anchors(target), link
    # Tables name files below the folder in their head.
    below = [ROOT, ROOT / "mnsf_ros", ROOT / "mnsf_ros" / "networks"]
    files = re.findall(r"`([\w./]+\.py|[\w.]+/[\w./]+\.(?:yaml|xml))`", text)
    assert [file for file in files if not any((top / file).exists() for top in below)] == []
    declared = set(Settings().to_mapping())
    groups = {name.partition(".")[0] for name in declared}
    names = set(re.findall(r"`([a-z_1-4]+\.[a-z_]+)[`:=]", text)) - declared - set(files)
    assert {name for name in names if name.split(".")[0] in groups} == set()


def test_documents_that_the_program_names_are_there():
    files = [file for top in SOURCES for file in (ROOT / top).rglob("*") if file.is_file()]
    texts = [file.read_text() for file in files if file.suffix in {".py", ".yaml", ".xml"}]
    named = {name for text in texts for name in re.findall(r"docs/\w+\.md", text)}
    assert {name for name in named if not (ROOT / name).exists()} == set()


@pytest.mark.parametrize("path", DOCUMENTS, ids=lambda path: path.name)
def test_commands_have_options_that_are_there(path, capsys):
    for words in commands(path):
        with pytest.raises(SystemExit) as ended:
            run([words[0], "--help"])
        assert ended.value.code == 0, words
        known = set(re.findall(r"--?[a-z][a-z-]*", capsys.readouterr().out))
        assert {word.partition("=")[0] for word in words if re.match(r"--?[a-z]", word)} <= known, (
            words
        )


@pytest.mark.parametrize(
    "name", ["README", "docs/getting_started", "docs/extending", "docs/recordings"]
)
def test_python_examples_run_one_after_the_other(name, make_street, tmp_path, monkeypatch):
    (tmp_path / "street").symlink_to(make_street())
    monkeypatch.chdir(tmp_path)
    sweep = np.random.default_rng(0).uniform(-9, 9, (500, 3)).astype(np.float32)
    names = {"np": np, "current": sweep, "next": sweep, "previous": sweep}
    for code in blocks(ROOT / f"{name}.md", "python"):
        exec(compile(code, name, "exec"), names)


def test_python_example_of_the_evaluation_runs(make_street, tmp_path, monkeypatch, capsys):
    (tmp_path / "street").symlink_to(make_street())
    monkeypatch.chdir(tmp_path)
    exec(compile(blocks(ROOT / "docs" / "evaluation.md", "python")[-1], "evaluation", "exec"), {})
    assert "online" in capsys.readouterr().out
