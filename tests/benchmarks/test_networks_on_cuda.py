# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script that checks and times everything on CUDA, tried on the CPU."""

from __future__ import annotations

import importlib
import sys
from pathlib import Path

import pytest
import torch

ROOT = Path(__file__).parents[2]


@pytest.fixture
def script(monkeypatch):
    monkeypatch.syspath_prepend(str(ROOT / "benchmarks"))
    monkeypatch.setenv("MNSF_DATA", "/nowhere")
    return importlib.import_module("networks_on_cuda")


def run(script, monkeypatch, *options):
    monkeypatch.setattr(sys, "argv", ["networks_on_cuda.py", *map(str, options)])
    script.main()


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is CUDA")
def test_without_cuda_it_says_so_in_one_line(script, monkeypatch, capsys):
    run(script, monkeypatch)
    assert capsys.readouterr().out == ("torch finds no usable CUDA device: nothing is measured\n")


def test_everything_is_measured_on_the_cpu(script, monkeypatch, tmp_path):
    monkeypatch.setattr(script, "real_sweeps", lambda name: [])
    monkeypatch.setattr(script, "simulated_sweeps", lambda seed, number: simulated(seed, 4))
    simulated = importlib.import_module("online_recordings").simulated_sweeps
    document = tmp_path / "document.md"
    document.write_text("<!-- begin cuda -->\n<!-- end cuda -->\n")
    options = ("--device", "cpu", "--sweeps", 2, "--points", 3000, "--few-steps")
    run(script, monkeypatch, *options, "--document", document)
    text = document.read_text()
    assert "DIFFERS" not in text
    assert script.UNMEASURED not in text
    assert text.count("| same |") == 1 + len(script.METHODS)
    for row in script.TIMED:
        assert f"| {row.name} |" in text


def test_rows_of_the_document_are_those_of_the_script(script):
    text = (ROOT / "docs" / "performance.md").read_text()
    section = text.partition("<!-- begin cuda -->")[2].partition("<!-- end cuda -->")[0]
    rows = [line.split("|")[1].strip() for line in section.splitlines() if line.startswith("|")]
    for table in (script.checks_table(), script.times_table({})):
        for row in table.rows:
            assert row[0] in rows
