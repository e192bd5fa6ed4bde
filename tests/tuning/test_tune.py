# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf tune` as users run it, and what it promises: figures of `mnsf evaluate`, two halves."""

from __future__ import annotations

import re
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from mnsf_ros.cli.main import EXIT_INTERRUPTED, EXIT_USAGE, run
from mnsf_ros.errors import EvaluationError, SettingsError
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, evaluated_methods
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.results import summarize
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.presets import preset
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.settings import declared_settings
from mnsf_ros.tuning import outcome
from mnsf_ros.tuning.halves import read_halves
from mnsf_ros.tuning.judges import LabelledJudge
from mnsf_ros.tuning.outcome import concluded
from mnsf_ros.tuning.search import Budget, tuned_settings
from mnsf_ros.tuning.tune import TuneOptions, search_settings

TWO = ("objects.min_probability", "ground.margin_m")
START = preset("online")
# Between 16 beams are gaps wider than the cells that suit 64.
GAIN = ["--parameters", "objects.cell_size_m,objects.thinning_m"]
GAIN += ["--trials", "6", "--max-examples", "4"]


@pytest.fixture(scope="module")
def recording(street):
    return choose_topics(inspect_recording(street), "street")


@pytest.fixture(scope="module")
def halves(recording):
    return read_halves([recording], EvaluationOptions(START), 40)


def numbers(half):
    return [example.number for example in half.stretches[0]]


def test_no_sweep_is_in_both_halves(halves, recording):
    first, second = map(numbers, halves)
    # Each example takes the sweep before and the one after, too.
    assert first == list(range(1, recording.num_sweeps // 2 - 1))
    assert second == list(range(recording.num_sweeps // 2 + 1, recording.num_sweeps - 1))


def test_examples_are_limited(recording):
    first, second = read_halves([recording], EvaluationOptions(START), 3)
    assert (first.num_examples, second.num_examples) == (3, 3)


def test_figures_are_those_of_evaluate(halves, recording):
    options = EvaluationOptions(START)
    (method,) = evaluated_methods(["online"], options)
    first = numbers(halves[0])
    skipped = frozenset(range(recording.num_sweeps)) - set(first)
    *rows, _ = run_task(EvaluationTask(recording, method, skipped), options)
    expected = summarize(rows)[0]
    found = LabelledJudge(halves[0], "epe").summary(options.settings)
    for name in ("errors", "three_way_epe_m", "movers", "consistency", "num_failed"):
        # As text: NaN stands for what could not be judged, and is not equal to itself.
        assert repr(getattr(found, name)) == repr(getattr(expected, name)), name


def test_settings_that_fail_do_not_win(halves):
    judge = LabelledJudge(halves[0], "epe")
    nothing = START.changed({"crop.max_range_m": 1.0})
    assert judge(nothing).cost == float("inf")


def tuned(recording, out, num_trials, **changes):
    options = TuneOptions(out, START, Budget(num_trials), TWO, "consistency", max_examples=4)
    found = search_settings([recording], replace(options, **changes), lambda *_: None)
    return concluded(found, lambda *_: None)


@pytest.fixture(scope="module")
def folder(recording, tmp_path_factory):
    pytest.importorskip("optuna")
    folder = tmp_path_factory.mktemp("tuned")
    return folder, tuned(recording, folder, 3)


def test_search_goes_on_as_if_it_had_not_stopped(recording, folder, tmp_path):
    tuned(recording, tmp_path, 2)
    with pytest.raises(EvaluationError, match="exists already; name another folder, or add --res"):
        tuned(recording, tmp_path, 3)
    with pytest.raises(EvaluationError, match="goal, max-examples differ"):
        tuned(recording, tmp_path, 3, resume=True, goal="epe", max_examples=3)
    again = tuned(recording, tmp_path, 3, resume=True)
    assert again == folder[1]


def test_outcome_is_no_worse_on_the_tuned_half(folder):
    before, after = folder[1].tuned
    assert after.cost <= before.cost
    assert folder[1].num_trials == 3
    assert before != folder[1].held_out[0]


def test_command_writes_what_changes(street, tmp_path, capsys):
    pytest.importorskip("optuna")
    out = tmp_path / "out"
    assert run(["tune", str(street), "--out", str(out), *GAIN]) == 0
    said = capsys.readouterr().out
    assert "What each change gains alone" in said
    assert "of the half that was not tuned" in " ".join(said.split())
    page = (out / "tuning.md").read_text()
    assert "three-way EPE (m)" in page
    changed = YAML(typ="safe").load(out / "tuned.yaml")["/**"]["ros__parameters"]
    names = {f"{group}.{name}" for group, values in changed.items() for name in values}
    assert names == {"objects.cell_size_m"}
    assert "| objects.cell_size_m | 0.15 | " in page
    assert (out / "tuned.yaml").read_text().startswith("# Written by `mnsf")


def test_without_gains_there_is_no_parameter_file(folder, tmp_path):
    nothing = replace(folder[1], gains=[])
    assert "keep the settings as they are; no parameter file is written" in nothing.verdict
    page = outcome.write_outcome(nothing, START, tmp_path, "mnsf tune street")
    assert page == [tmp_path / "tuning.md"]


def test_interrupted_search_says_how_to_go_on(street, tmp_path, capsys, monkeypatch):
    pytest.importorskip("optuna")
    num_judged = 0
    summary = LabelledJudge.summary

    def interrupted_later(judge, settings):
        nonlocal num_judged
        num_judged += 1
        if num_judged == 3:
            raise KeyboardInterrupt
        return summary(judge, settings)

    monkeypatch.setattr(LabelledJudge, "summary", interrupted_later)
    out = tmp_path / "out"
    arguments = ["tune", str(street), "--out", str(out), "--trials", "4", "--max-examples", "2"]
    assert run(arguments) == EXIT_INTERRUPTED
    said = capsys.readouterr().out.strip().splitlines()[-1]
    assert re.fullmatch(
        rf"2 trials, lowest cost \d\.\d+; repeat the command with --resume .* {out}", said
    )
    assert [path.name for path in out.iterdir()] == ["trials.log"]


def test_best_trial_is_kept_while_its_gains_are_measured(street, tmp_path, monkeypatch):
    pytest.importorskip("optuna")
    out = tmp_path / "out"
    shown = []

    def interrupted(found, watch):
        concluded(found, lambda *numbers: shown.append(numbers))
        raise KeyboardInterrupt

    monkeypatch.setattr(outcome, "concluded", interrupted)
    assert run(["tune", str(street), "--out", str(out), *GAIN]) == EXIT_INTERRUPTED
    text = (out / "tuned.yaml").read_text()
    assert "Best of 6 trials; not judged on the other half yet." in " ".join(
        text.replace("#", "").split()
    )
    assert "cell_size_m" in text
    assert [done for done, _ in shown] == list(range(1, len(shown) + 1))
    assert shown[-1][0] == shown[-1][1]


def test_without_optuna_it_is_one_line(street, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert run(["tune", str(street), "--out", str(tmp_path / "out")]) == EXIT_USAGE
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "'optuna' is not installed" in said
    assert "pip install" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--trials", "0"], "got 0 trials"),
        (["--minutes", "0"], "0 minutes"),
        (["--minutes", "nan"], "nan minutes"),
        (["--max-examples", "0"], "max-examples: got 0"),
        (["--parameters", "crop.max_range_m"], "cannot be tuned; choose from"),
        (["--parameters", "objects.min_prob"], "or objects.min_probability or"),
        (["--parameters", TWO[0], "--set", f"{TWO[0]}=0.4"], "no parameter is left to tune"),
        (["--set", "method.name=mnsf"], "method.name"),
    ],
)
def test_what_cannot_be_used(street, tmp_path, capsys, arguments, text):
    pytest.importorskip("optuna")
    assert run(["tune", str(street), "--out", str(tmp_path / "out"), *arguments]) == EXIT_USAGE
    assert text in capsys.readouterr().err
    assert not (tmp_path / "out").exists()


def test_labels_are_needed_for_their_goals(recording, tmp_path):
    unlabelled = replace(recording, truth=None)
    with pytest.raises(EvaluationError, match="--goal iou needs true flow, which street has not"):
        tuned(unlabelled, tmp_path, 3, goal="iou")


def test_recording_that_is_too_short(recording):
    with pytest.raises(EvaluationError, match="street: too short to tune on one half"):
        read_halves([replace(recording, num_sweeps=2)], EvaluationOptions(START), 40)


def test_declared_ranges():
    for setting in tuned_settings():
        low, high = setting.tuned
        assert low <= setting.default <= high
        assert setting.checked(setting.kind(low)) < setting.checked(setting.kind(high))
    fixed = frozenset({"objects.min_points"})
    assert {one.name for one in tuned_settings()} - {
        one.name for one in tuned_settings((), fixed)
    } == fixed
    assert 5 < len(tuned_settings()) < len(declared_settings())
    with pytest.raises(SettingsError, match=r"compute\.seed: cannot be tuned"):
        tuned_settings(["compute.seed"])


def test_document_names_what_is_tuned():
    page = (Path(__file__).parents[2] / "docs" / "tuning.md").read_text()
    listed = page.partition("By default these are tuned: ")[2].partition(". `--parameters`")[0]
    assert set(re.findall(r"`([\w.]+)`", listed)) == {one.name for one in tuned_settings()}
