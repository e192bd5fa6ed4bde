# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf tune` as users run it, and what it promises: figures of `mnsf evaluate`, two halves."""

import os
import sys
from dataclasses import replace

import pytest
from ruamel.yaml import YAML

from mnsf_ros.cli.main import EXIT_INTERRUPTED, EXIT_USAGE, run
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, evaluated_methods
from mnsf_ros.evaluation.recordings import choose_topics
from mnsf_ros.evaluation.summary import summarize
from mnsf_ros.evaluation.task import run_task
from mnsf_ros.presets import preset
from mnsf_ros.tuning.judges import LabelledJudge, read_halves
from mnsf_ros.tuning.tune import TuneOptions, tune, tuned_settings

TWO = ("objects.min_probability", "ground.margin_m")
START = preset("online")


@pytest.fixture(scope="module")
def recording(street):
    return choose_topics(street, "street")


@pytest.fixture(scope="module")
def halves(recording):
    return read_halves([recording], EvaluationOptions(START))


def numbers(half):
    return [example.number for example in half[0]]


def test_no_sweep_is_in_both_halves(halves, recording):
    first, second = map(numbers, halves)
    # Each example takes the sweep before and the one after, too.
    assert first == list(range(1, recording.num_sweeps // 2 - 1))
    assert second == list(range(recording.num_sweeps // 2 + 1, recording.num_sweeps - 1))


def test_figures_are_those_of_evaluate(halves, recording):
    options = EvaluationOptions(START)
    (method,) = evaluated_methods(["online"], options)
    first = numbers(halves[0])
    skipped = frozenset(range(recording.num_sweeps)) - set(first)
    *rows, _ = run_task(EvaluationTask(recording, method, skipped), options)
    expected = summarize(rows).loc["online"]
    found = LabelledJudge(halves[0]).summary(options.settings)
    kinds = ("errors", "three_way", "movers", "consistency", "num_failed")
    names = [name for name in expected.index if name.startswith(kinds)]
    assert found[names].equals(expected[names])


def test_settings_that_fail_do_not_win(halves):
    judge = LabelledJudge(halves[0])
    assert judge(START.changed({"crop.max_range_m": 1.0})) == float("inf")


def tuned(recording, out, num_trials, *, resume=False, **changes):
    values = {"goal": "consistency", "max_examples": 4, **changes}
    options = TuneOptions(values["goal"], num_trials, ",".join(TWO))
    evaluation = EvaluationOptions(START, max_examples=values["max_examples"])
    return tune([recording], evaluation, options, out, lambda *_: None, resume=resume)


def test_search_is_resumed(recording, tmp_path):
    pytest.importorskip("optuna")
    first = tuned(recording, tmp_path, 2)
    with pytest.raises(EvaluationError, match="exists already; name another folder, or add --res"):
        tuned(recording, tmp_path, 3)
    with pytest.raises(EvaluationError, match="max_examples, goal differ"):
        tuned(recording, tmp_path, 3, resume=True, goal="epe", max_examples=3)
    second = tuned(recording, tmp_path, 3, resume=True)
    assert (first.num_trials, second.num_trials) == (2, 3)
    before, after = second.tuned
    assert after <= before
    assert before == first.tuned[0] != second.held_out[0]


@pytest.mark.parametrize("content", [b"\xc4\x00", b'{"op_code": 99}\n', None])
def test_damaged_trials_are_refused_in_one_line(recording, tmp_path, content):
    pytest.importorskip("optuna")
    trials = tmp_path / "trials.log"
    os.mkfifo(trials) if content is None else trials.write_bytes(content)
    with pytest.raises(EvaluationError, match=r"trials\.log: (is not a file|cannot be read)"):
        tuned(recording, tmp_path, 1, resume=True)


def test_command_writes_what_changes(street, tmp_path, capsys):
    pytest.importorskip("optuna")
    out = tmp_path / "out"
    # Between 16 beams are gaps wider than the cells that suit 64.
    few = ["--parameters", "objects.cell_size_m,objects.thinning_m", "--max-examples", "4"]
    arguments = ["tune", str(street), "--out", str(out), *few, "--trials"]
    assert run([*arguments, "1"]) == 0
    assert "keep the settings as they are" in " ".join(capsys.readouterr().out.split())
    assert {path.name for path in out.iterdir()} == {"trials.log"}
    assert run([*arguments, "6", "--resume"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "objects.cell_size_m: 0.15 -> " in said
    assert "of the half that was not tuned" in said
    assert "three-way EPE (m) of the tuned half" in said
    changed = YAML(typ="safe").load(out / "tuned.yaml")["/**"]["ros__parameters"]
    assert set(changed) == {"objects"}
    assert (out / "tuned.yaml").read_text().startswith("# Written by `mnsf")


def test_interrupted_search_says_how_to_go_on(street, tmp_path, capsys, monkeypatch):
    pytest.importorskip("optuna")

    def interrupted(judge, settings):
        raise KeyboardInterrupt

    monkeypatch.setattr(LabelledJudge, "summary", interrupted)
    out = tmp_path / "out"
    arguments = ["tune", str(street), "--out", str(out), "--trials", "4", "--max-examples", "2"]
    assert run(arguments) == EXIT_INTERRUPTED
    assert "add --resume" in " ".join(capsys.readouterr().out.split())
    assert [path.name for path in out.iterdir()] == ["trials.log"]


def test_missing_optuna_is_said_first(tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "optuna", None)
    assert run(["tune", str(tmp_path), "--out", str(tmp_path / "out")]) == EXIT_USAGE
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert "'optuna' is not installed" in said
    assert "pip install" in said
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--trials", "0"], "trials: got 0"),
        (["--max-examples", "-1"], "max-examples: got -1"),
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


def test_recordings_that_cannot_be_used(recording, tmp_path):
    unlabelled = replace(recording, truth=None)
    with pytest.raises(EvaluationError, match="--goal epe needs true flow, which street has not"):
        tuned(unlabelled, tmp_path, 3, goal="epe")
    with pytest.raises(EvaluationError, match="street: too short to tune on one half"):
        read_halves([replace(recording, num_sweeps=2)], EvaluationOptions(START))


def test_declared_ranges():
    for setting in tuned_settings():
        low, high = setting.tuned
        assert low <= setting.default <= high
        assert setting.checked(setting.kind(low)) < setting.checked(setting.kind(high))
