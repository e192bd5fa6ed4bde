# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`make benchmark`: its plan, its results, and its tables."""

from __future__ import annotations

import sys

import pandas as pd
import pytest

from mnsf_ros.methods import make_method


@pytest.fixture
def paper(load):
    return load("paper_table")


def results(paper, row, *epes_m, moments=None):
    """Results of one row, one EPE a seed, a bit more at the first moment."""
    return [
        {"row": row, "seed": seed, "moment": moment}
        | dict.fromkeys(paper.COLUMNS, 0.5)
        | {"epe_m": epe_m + 0.004 * (moment == paper.MOMENTS[0])}
        for seed, epe_m in enumerate(epes_m)
        for moment in moments or paper.MOMENTS
    ]


def test_first_seed_of_all_rows_comes_first(paper):
    jobs = paper.planned(["fnsf", "mnsf"])
    assert len(jobs) == 2 * 4 * 3
    assert {job.seed for job in jobs[:8]} == {0}


def test_every_row_can_be_made_with_its_settings(paper):
    for row in paper.ROWS:
        job = paper.Job(row, 1, 5)
        settings = make_method(job.method, job.settings).settings
        assert not settings.ground.remove
        assert settings.compute.seed == 1


def test_interrupted_run_goes_on_where_it_was(paper, tmp_path, monkeypatch):
    figures = dict.fromkeys(paper.COLUMNS, 0.5)
    measured = []
    monkeypatch.setattr(paper, "measured", lambda job: measured.append(job) or figures)
    file, jobs = tmp_path / "rows.jsonl", paper.planned(["zero"])
    paper.run(jobs[:2], file)
    whole = file.read_text()
    file.write_text(f'{whole}{{"row": "ze')
    paper.run(jobs, file)
    assert measured == jobs
    assert file.read_text().startswith(whole)
    assert len(paper.read_rows(file)) == len(jobs)


def test_figures_are_means_over_seeds_with_all_moments(paper):
    unfinished = results(paper, "mnsf", 0.0, 0.0, 9.0, moments=(5,))[2:]
    rows = pd.DataFrame([*results(paper, "mnsf", 0.05, 0.07), *unfinished])
    cells = {row[0]: row for row in paper.table(rows).rows}
    assert cells["mnsf"][1:3] == ["0.061", "50.0"]
    assert cells["mnsf, authors' code"][1] == "0.087"
    assert cells["online"][1:] == [""] * 5


def test_without_data_nothing_is_done(paper, tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(paper, "DATA", tmp_path / "nowhere")
    monkeypatch.setattr(sys, "argv", ["paper_table.py", "--out", str(tmp_path / "out")])
    paper.main()
    assert capsys.readouterr().out.startswith(f"Nothing to measure: there is no {tmp_path}")
    assert not list(tmp_path.iterdir())
