# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The scripts of `make benchmark`: what is planned, what is summarized, and how it is judged."""

from __future__ import annotations

import importlib
import os
import subprocess
import sys
from pathlib import Path

import pytest

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.results import Failure, FailureKind, ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import MachineRecord, SessionRecord
from mnsf_ros.methods import method_names
from mnsf_ros.presets import PRESET_NAMES, preset

BENCHMARKS = Path(__file__).parents[2] / "benchmarks"
MOMENTS = (5, 10, 15, 20)
LEARNED = {"flot", "3dflow", "gmsf", "scoop"}


@pytest.fixture
def load(monkeypatch):
    monkeypatch.syspath_prepend(str(BENCHMARKS))
    return importlib.import_module


def row(method, seed, moment, epe_m, *, scale="8192", failure=""):
    def errors(value):
        return FlowErrors(value, 0.6, 0.8, 0.5, 0.1, 100)

    parts = {"all": errors(epe_m), "dynamic": errors(5 * epe_m), "static": errors(epe_m / 2)}
    recording = f"{scale} seed {seed}"
    reason = Failure(FailureKind.FAILED, failure) if failure else None
    return ResultRow(recording, moment, 0, method, 100, 1e3, errors=parts, failure=reason)


def rows_of(method, *epes_m, **more):
    """One row for each moment and seed; EPE is that of the seed, and at moment 5 a bit more."""
    return [
        row(method, seed, moment, epe_m + 0.004 * (moment == 5), **more)
        for seed, epe_m in enumerate(epes_m)
        for moment in MOMENTS
    ]


def test_line_that_was_being_written_is_cut_off_before_a_run_goes_on(load, tmp_path):
    folder = RunFolder(tmp_path)
    folder.add_row(row("mnsf", 0, 5, 0.1))
    file = tmp_path / "rows.jsonl"
    whole = file.read_text()
    file.write_text(f"{whole}half a li")
    load("paper_table").run([], folder, again=(), console=None)
    assert file.read_text() == whole


def test_plan_has_every_method_at_both_scales(load):
    plan, figures = load("paper_plan"), load("paper_figures")
    jobs = {job for part in plan.PLAN for job in plan.planned(part)}
    ours = {name for name in method_names() if name not in LEARNED}
    for scale in ("8192", "full"):
        methods = {job.method for job in jobs if job.scale == scale}
        assert ours - set(figures.SAME_AS) <= methods
        assert set(figures.SAME_AS.values()) <= methods
    assert {job.method.rpartition("/")[0] or "paper" for job in jobs} <= set(PRESET_NAMES)


def test_part_of_a_plan(load):
    plan = load("paper_plan")
    jobs = plan.planned("full:mnsf,online/mnsf:2")
    assert len(jobs) == 2 * 2 * 4
    assert jobs[0] == plan.Job("full", "mnsf", 0, 5)
    assert jobs[-1] == plan.Job("full", "online/mnsf", 1, 20)
    assert jobs[-1].settings.compute.seed == 1
    assert not jobs[0].settings.ground.remove
    assert jobs[0].settings.field != jobs[-1].settings.field


@pytest.mark.parametrize("part", ["mnsf", "8192:mnsf", "some:mnsf:1", "full:mnsf:all"])
def test_part_of_a_plan_that_is_none(load, part):
    with pytest.raises(ValueError, match="plan"):
        load("paper_plan").planned(part)


def test_what_is_done_is_not_planned_again(load):
    plan = load("paper_plan")
    jobs, rows = plan.planned("8192:mnsf,fnsf:2"), rows_of("mnsf", 0.05)
    assert plan.done_jobs(rows) == set(jobs[:4])
    assert plan.missing(jobs, rows) == ["8192 seed 1: mnsf, fnsf", "8192 seed 0: fnsf"]


def test_record_of_settings_is_that_of_each_method(load):
    module = load("paper_plan")
    before = dict(preset("paper").to_mapping())
    early = {"paper": before | {"objects.cell_size_m": 9.0, "nsfp.patience": 1}}
    assert module.outdated(early, ["mnsf", "fnsf", "nsfp", "online"]) == [
        "nsfp: nsfp.patience",
        "online: objects.cell_size_m",
    ]
    merged = module.merged_settings(early, ["nsfp", "mnsf"], ["mnsf", "ego"])
    assert merged["nsfp"]["nsfp.patience"] == 1
    assert "nsfp.patience" not in merged["mnsf"]
    assert merged["mnsf"] == module.settings_of("mnsf")
    assert module.outdated(merged, ["nsfp", "mnsf"]) == ["nsfp: nsfp.patience"]
    with pytest.raises(EvaluationError, match=r"rows of nsfp .* another nsfp.patience; `--again"):
        module.merged_settings(early, ["nsfp", "mnsf"], ["nsfp"])


def test_setting_that_is_new_has_not_changed(load):
    before = dict(preset("paper").to_mapping())
    del before["mnsf_cycle.weight"]
    assert load("paper_plan").outdated({"paper": before}, ["mnsf-cycle"]) == []


def test_figures_are_means_over_seeds_that_are_complete(load):
    measured_of = load("paper_figures").measured_of
    rows = [*rows_of("mnsf", 0.05, 0.07), row("mnsf", 2, 5, 9.0), *rows_of("fnsf", 0.1)]
    found = measured_of(rows, "8192", "mnsf")
    assert found.num_seeds == 2
    assert found.errors["all"].epe_m == pytest.approx((0.051 + 0.071) / 2)
    assert found.errors["dynamic"].epe_m == pytest.approx(5 * 0.061)
    assert [seed.epe_m for seed in found.of_seeds["all"]] == pytest.approx([0.051, 0.071])
    assert found.time_ms == 1e3
    # The same estimate under the name of another table.
    assert measured_of(rows, "8192", "mnsf+fusion.num_hidden_layers=3") == found
    assert measured_of(rows, "full", "mnsf") is None
    assert measured_of(rows_of("mnsf", 0.05, failure="no flow"), "8192", "mnsf") is None


NAN = float("nan")
AUTHORS = {"EPE (m)": 0.050, "Acc5 (%)": 60.0, "EPE dynamic": 0.300, "EPE static": 0.040}


@pytest.mark.parametrize(
    ("ours", "spread", "text"),
    [
        ((0.050, 60.0, 0.300, 0.040), NAN, "no worse"),
        ((0.0504, 59.96, 0.3004, 0.0404), NAN, "no worse"),
        ((0.040, 70.0, 0.200, 0.030), 0.1, "no worse"),
        ((0.053, 60.0, 0.300, 0.040), NAN, "worse in EPE by 0.003"),
        ((0.053, 60.0, 0.300, 0.040), 0.002, "worse in EPE by 0.003"),
        ((0.053, 60.0, 0.300, 0.040), 0.004, "no worse, within the seeds (EPE by 0.003)"),
        ((0.040, 58.5, 0.310, 0.030), 0.1, "worse in Acc5 by 1.5"),
        ((0.040, 58.5, 0.310, 0.030), 0.001, "worse in Acc5 by 1.5, EPE dynamic by 0.010"),
    ],
)
def test_verdict(load, ours, spread, text):
    verdict = load("paper_figures").verdict
    figures = dict(zip(AUTHORS, ours, strict=True))
    assert verdict(AUTHORS, figures, dict.fromkeys(AUTHORS, spread)) == text


def test_document(load):
    session = SessionRecord(
        started="2026-01-02T03:04:05",
        command=[],
        machine=MachineRecord("m", system="S", processor="P", cores=2, gpu=None),
        versions={"torch": "2"},
        git_commit="0123456789abcdef+changes",
    )
    rows = [
        *rows_of("mnsf", 0.05, 0.07),
        *rows_of("ego", 0.01),
        row("nsfp", 0, 5, 0.1, failure="?"),
    ]
    text = load("paper_document").document(
        rows, [session, session], ["full seed 0: mnsf"], ["ego: crop.x"]
    )
    for part in (
        "* Machine: m: P, 2 cores, no GPU, S\n",
        "* Commit: 0123456789ab and changes\n",
        "* full seed 0: mnsf\n",
        "* ego: crop.x\n",
        "* nsfp, 8192 seed 0: ?\n",
        "| mnsf | 0.061 ± 0.014 | 60.0 ± 0.0 | 0.305 ± 0.071 | ",
        "| authors' MNSF | 0.087 | 51.5 | 0.285 | 0.073 |  |\n",
        "## Fusion depth, 8,192 points\n",
        "| ego | 0.011 | 60.0 | 80.0 | 50.0 | 0.100 | 1000 | ",
    ):
        assert part in text
    assert "full sweeps\n\n|" not in text


def test_section_of_a_document_is_replaced(load, tmp_path):
    replace_section = load("marked_section").replace_section
    document = tmp_path / "performance.md"
    document.write_text("before\n<!-- begin x -->\nold\n<!-- end x -->\nafter\n")
    replace_section(document, "x", "new\n")
    text = "before\n<!-- begin x -->\nnew\n<!-- end x -->\nafter\n"
    assert document.read_text() == text
    with pytest.raises(ValueError, match="begin y"):
        replace_section(document, "y", "new")
    assert document.read_text() == text


def test_without_data_one_sentence_and_nothing_else(tmp_path):
    done = subprocess.run(
        [sys.executable, BENCHMARKS / "paper_table.py", "--document", "table.md"],
        cwd=tmp_path,
        env=os.environ | {"MNSF_DATA": str(tmp_path / "nowhere")},
        capture_output=True,
        text=True,
        check=True,
    )
    assert "Nothing to measure: " in done.stdout
    assert "nowhere" in done.stdout
    # Loops that are compiled at the first start say so there.
    assert "Traceback" not in done.stderr
    assert list(tmp_path.iterdir()) == []
