# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The script that checks and times the networks on CUDA, tried on the CPU."""

import sys

import pytest
import torch

from mnsf_ros.presets import preset


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
def test_everything_is_measured_on_the_cpu(run, load, monkeypatch, tmp_path):
    script = load("networks_on_cuda")
    few = {"optimization.max_iterations": 4, "fusion.max_iterations": 4, "distance.kind": "tree"}
    coarse = {"distance.cell_size_m": 0.5}
    monkeypatch.setattr(script, "preset", lambda name: preset(name).changed(few | coarse))
    sweeps = load("drives").simulated_sweeps(0, 4, num_beams=16, num_columns=400)
    monkeypatch.setattr(script, "real_sweeps", lambda name: sweeps)
    document = tmp_path / "document.md"
    document.write_text("<!-- begin cuda -->\n<!-- end cuda -->\n")
    run("--device", "cpu", "--sweeps", 2, "--document", document)
    kinds = [f"{kind}, one core" for kind in ("grid", "bricks", "tree")]
    assert all(f"| {name} |" in document.read_text() for name in (*script.ROWS, *kinds))
