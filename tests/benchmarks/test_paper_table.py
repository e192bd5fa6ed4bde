# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`make benchmark`: runs of `mnsf evaluate`, and their tables."""

import sys

import pandas as pd
import pytest


@pytest.fixture
def paper(load):
    return load("paper_table")


@pytest.mark.slow
def test_rows_of_several_presets_are_evaluated_and_go_on(paper, make_street, tmp_path, capfd):
    rows = ["ego", "authors/zero", "zero"]
    found, again = (paper.evaluated(make_street(), tmp_path, 1, rows) for _ in range(2))
    assert list(found.index) == rows
    assert found["EPE (m)"]["zero"] == found["EPE (m)"]["authors/zero"] > found["EPE (m)"]["ego"]
    pd.testing.assert_frame_equal(found, again)
    assert capfd.readouterr().out.count(" on street: done") == len(rows)


def test_figures_are_beside_those_of_the_authors(paper):
    means = pd.DataFrame({"EPE (m)": [0.0674, 0.034], "dynamic": 0.316}, index=["mnsf", "online"])
    table = paper.table("Sweeps", means, ("EPE (m)", "dynamic"), {"mnsf": ("0.087", "0.285")})
    assert table.header == ["", "EPE (m)", "EPE dynamic (m)"]
    assert table.rows == [
        ["mnsf", "0.067", "0.316"],
        ["mnsf, authors' code", "0.087", "0.285", ""],
        ["online", "0.034", "0.316"],
    ]


def test_without_data_nothing_is_done(paper, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(paper, "DATA", tmp_path / "nowhere")
    monkeypatch.setattr(sys, "argv", ["paper_table.py", "--out", str(tmp_path / "out")])
    paper.main()
    assert capsys.readouterr().out.startswith(f"Nothing to measure: there is no {tmp_path}")
    assert not list(tmp_path.iterdir())
