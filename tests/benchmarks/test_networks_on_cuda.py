# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script that checks and times the networks on CUDA, tried on the CPU."""

from __future__ import annotations

import sys

import pytest
import torch


@pytest.fixture
def run(load, monkeypatch):
    script = load("networks_on_cuda")

    def run(*options):
        monkeypatch.setattr(sys, "argv", ["networks_on_cuda.py", *map(str, options)])
        script.main()
        return script

    return run


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is CUDA")
def test_without_cuda_it_says_so_in_one_line(run, capsys):
    run()
    assert capsys.readouterr().out == "torch finds no usable CUDA device: nothing is measured\n"


@pytest.mark.slow
def test_everything_is_measured_on_the_cpu(run, load, monkeypatch, tmp_path, capsys):
    script = load("networks_on_cuda")
    sweeps = load("drives").simulated_sweeps(0, 4)
    monkeypatch.setattr(script, "real_sweeps", lambda name: sweeps)
    document = tmp_path / "document.md"
    document.write_text("<!-- begin cuda -->\n<!-- end cuda -->\n")
    options = ("--device", "cpu", "--sweeps", 2, "--points", 3000, "--few-steps")
    run(*options, "--document", document)
    text = document.read_text()
    number = 1 + len(script.METHODS)
    assert f"{number} of {number} results are those of the CPU" in text
    assert "DIFFERS" not in capsys.readouterr().out
    assert all(f"| {name} |" in text for name in script.TIMED)
