# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf evaluate` as users run it, on recordings that take a second."""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
import small_evaluations as small

from mnsf_ros.cli import evaluate, main
from mnsf_ros.cli.evaluation import new_folder
from mnsf_ros.core import memory_demand
from mnsf_ros.errors import EvaluationError, MnsfError, RecordingError, SettingsError
from mnsf_ros.evaluation.executors import run_serially
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.settings import parse_assignments
from msg_utils.point_cloud2 import encode_columns

# Those that start a process draw all the same.
pytestmark = pytest.mark.usefixtures("without_drawing")

SETTINGS = [f"--set={name}={value}" for name, value in small.TINY.items()]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 6)


def mnsf(*arguments, pictures=0):
    parser = argparse.ArgumentParser()
    evaluate.add_to(parser.add_subparsers())
    few = ["--pictures", str(pictures), *SETTINGS]
    options = parser.parse_args(["evaluate", *map(str, arguments), *few])
    return options.run(options)


def cut(bag, copy, share=0.6):
    copy.mkdir()
    for file in bag.iterdir():
        data = file.read_bytes()
        keeps_all = file.suffix != ".mcap"
        (copy / file.name).write_bytes(data if keeps_all else data[: int(len(data) * share)])
    return copy


def test_bag_in_table_out(bag, tmp_path, capsys):
    out = tmp_path / "out"
    assert mnsf(bag, "--methods", "zero,ego,fnsf", "--num-points", 30, "--out", out) == 0
    printed = capsys.readouterr().out
    for method in ("zero", "ego", "fnsf"):
        assert method in printed
    assert "EPE (m)" in printed
    assert "mean over 4 examples" in " ".join(printed.split())
    for name in (
        "run.json",
        "rows.jsonl",
        "tasks.jsonl",
        "results.md",
        "results.csv",
        "report.html",
    ):
        assert (out / name).stat().st_size > 0
    assert len((out / "rows.jsonl").read_text().splitlines()) == 12
    assert json.loads((out / "results.json").read_text())["methods"][1]["method"] == "ego"


def test_without_pytorch_the_default_is_what_robots_run(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    out = tmp_path / "out"
    assert mnsf(bag, "--out", out) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "mnsf is not evaluated: " in printed
    assert "torch" in printed
    assert json.loads((out / "run.json").read_text())["methods"][0]["name"] == "online"
    assert "\nmnsf," not in (out / "results.csv").read_text()
    # Whoever names it is told what to install, and nothing is run.
    with pytest.raises(SettingsError, match="torch"):
        mnsf(bag, "--methods", "mnsf", "--out", tmp_path / "other")


def test_several_recordings_at_once(bag, tmp_path):
    other = small.write_recording(tmp_path / "other", 4)
    # As the command parses it, recordings may stand anywhere.
    arguments = ["evaluate", bag, "--methods", "ego", other, "--out", tmp_path / "out"]
    assert main.run([*map(str, arguments), "--pictures=0", *SETTINGS]) == 0
    rows = [json.loads(line) for line in (tmp_path / "out" / "rows.jsonl").read_text().splitlines()]
    assert [row["recording"] for row in rows] == ["drive"] * 4 + ["other"] * 2


def test_workers_and_written_flow(bag, tmp_path):
    out = tmp_path / "out"
    arguments = [bag, "--methods=zero,ego", "--workers=2", "--write-flow", "--out", out]
    assert mnsf(*arguments) == 0
    assert sorted(path.name for path in (out / "flow").iterdir()) == ["drive.ego", "drive.zero"]


def test_report_has_pictures_of_written_flow(bag, tmp_path, capsys):
    out = tmp_path / "out"
    arguments = [bag, "--methods=fnsf", "--num-points=30", "--write-flow", "--out", out]
    assert mnsf(*arguments, pictures=1) == 0
    assert f"Report: {out / 'report.html'}" in "".join(capsys.readouterr().out.split("\n"))
    text = (out / "report.html").read_text()
    assert "data:image/png" in text


@pytest.mark.parametrize(("preset_name", "method"), [("paper", "mnsf"), ("online", "online")])
def test_report_of_a_bag_without_truth_has_pictures(tmp_path, capsys, preset_name, method):
    bag = small.write_recording(tmp_path / "bag", 6, with_truth=False, with_odometry=False)
    out = tmp_path / "out"
    arguments = [bag, f"--methods={method},zero", f"--preset={preset_name}", "--ground=settings"]
    assert mnsf(*arguments, "--set=ground.remove=false", "--out", out, pictures=2) == 0
    printed = capsys.readouterr().out
    assert f"Report: {out / 'report.html'}" in "".join(printed.split("\n"))
    text = (out / "report.html").read_text()
    assert text.count("data:image/png") == text.count(f"<figcaption>{method}: ") == 2
    assert len((out / "rows.jsonl").read_text().splitlines()) == 8


@pytest.mark.parametrize("error", [OSError("disk full"), ZeroDivisionError("a bug")])
def test_results_survive_a_report_that_fails(bag, tmp_path, capsys, monkeypatch, error):
    def write_report(*_, **__):
        raise error

    monkeypatch.setattr("mnsf_ros.cli.evaluation.write_report", write_report)
    out = tmp_path / "out"
    assert mnsf(bag, "--methods", "zero", "--out", out) == evaluate.EXIT_INCOMPLETE
    assert "no report: " in capsys.readouterr().out
    assert (out / "results.json").stat().st_size > 0
    assert not (out / "report.html").exists()


def test_nothing_is_overwritten_and_resume_goes_on(bag, tmp_path):
    out = tmp_path / "out"
    assert mnsf(bag, "--methods", "zero", "--out", out) == 0
    with pytest.raises(EvaluationError, match="exists already"):
        mnsf(bag, "--methods", "zero", "--out", out)
    with pytest.raises(EvaluationError, match="other settings"):
        mnsf(bag, "--methods", "zero", "--out", out, "--resume", "--seed", "3")
    assert mnsf(bag, "--methods", "zero,ego", "--out", out, "--resume") == 0
    assert len((out / "rows.jsonl").read_text().splitlines()) == 8


def test_without_a_folder_results_go_to_a_new_one(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other = small.write_recording(tmp_path / "bags" / "other", 4)
    assert mnsf(bag, "--methods", "zero") == 0
    assert mnsf(bag, other, "--methods", "zero") == 0
    several, one = sorted(path.name for path in tmp_path.iterdir() if path.name != "bags")
    assert re.fullmatch(r"drive-\d{8}-\d{6}", one)
    assert re.fullmatch(r"drive\+1-\d{8}-\d{6}", several)
    printed = capsys.readouterr().out
    for name in (one, several):
        assert f"Results folder: {name}" in printed
        assert (tmp_path / name / "results.md").stat().st_size > 0


def test_no_folder_is_named_that_is_not_made(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(MnsfError, match="none: no such file"):
        mnsf("none", "--methods", "zero")
    assert "Results folder" not in capsys.readouterr().out
    assert list(tmp_path.iterdir()) == []


def test_default_folder_is_never_one_that_is_there(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(3):
        folder = new_folder([Path("street.mcap")])
        folder.mkdir()
    assert len(list(tmp_path.iterdir())) == 3


def test_resume_needs_the_folder(bag, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    arguments = ["evaluate", str(bag), "--methods", "zero", "--resume"]
    assert main.run(arguments) == main.EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert "--resume needs --out" in line
    assert list(tmp_path.iterdir()) == []


def test_run_of_an_early_version_is_not_resumed_but_reported(bag, tmp_path, capsys):
    out = tmp_path / "out"
    assert mnsf(bag, "--methods", "zero", "--out", out) == 0
    run = small.old_run_record(json.loads((out / "run.json").read_text()))
    (out / "run.json").write_text(json.dumps(run))
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    texts = [json.dumps(row | {"failure": ""}) for row in rows]
    (out / "rows.jsonl").write_text("".join(f"{text}\n" for text in texts))
    before = {file: file.read_bytes() for file in out.iterdir()}
    arguments = ["evaluate", str(bag), "--methods=zero", *SETTINGS, f"--out={out}", "--resume"]
    capsys.readouterr()
    assert main.run(arguments) == main.EXIT_USAGE
    assert "another version" in capsys.readouterr().err
    assert {file: file.read_bytes() for file in out.iterdir()} == before
    assert main.run(["report", str(out)]) == 0
    assert "zero" in (out / "report.html").read_text()


def test_interruption_leaves_a_table_of_what_is_finished(bag, tmp_path, capsys, monkeypatch):
    def run_until_interrupted(runs, options):
        events = run_serially(runs, options)
        for _ in range(6):
            yield next(events)
        raise KeyboardInterrupt

    monkeypatch.setattr("mnsf_ros.cli.evaluation.run_serially", run_until_interrupted)
    with pytest.raises(KeyboardInterrupt):
        mnsf(bag, "--methods", "zero,ego", "--out", tmp_path / "out")
    assert "Unfinished: ego on drive, examples so far: 1;" in capsys.readouterr().out
    page = (tmp_path / "out" / "results.md").read_text()
    assert "over 1 to 4 examples" in page
    assert "Unfinished: ego on drive" in page
    assert "Unfinished: zero" not in page


def test_resume_says_what_starts_again(bag, tmp_path, capsys, monkeypatch):
    def run_until_interrupted(runs, options):
        events = run_serially(runs, options)
        yield next(events)
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr("mnsf_ros.cli.evaluation.run_serially", run_until_interrupted)
        with pytest.raises(KeyboardInterrupt):
            mnsf(bag, "--methods", "zero", "--write-flow", "--out", tmp_path / "out")
    assert "starts again" not in capsys.readouterr().out
    arguments = [bag, "--methods", "zero,ego", "--write-flow", "--out", tmp_path / "out"]
    assert mnsf(*arguments, "--resume") == 0
    said = " ".join(capsys.readouterr().out.split())
    assert said.count("starts again") == 1
    assert "zero on drive: cannot go on in the middle, starts again" in said


def test_folder_that_cannot_be_made_is_one_line(bag, capsys):
    assert mnsf(bag, "--methods", "zero", "--out", "/proc/results") == evaluate.EXIT_UNWRITTEN
    assert capsys.readouterr().err.startswith("mnsf: /proc/results: cannot be written: ")


def test_damaged_recording_is_evaluated_as_far_as_it_goes(bag, tmp_path, capsys):
    damaged = cut(bag, tmp_path / "cut")
    status = mnsf(damaged, "--methods", "ego", "--out", tmp_path / "out")
    assert status == evaluate.EXIT_INCOMPLETE
    rows = (tmp_path / "out" / "rows.jsonl").read_text().splitlines()
    assert 0 < len(rows) < 4
    printed = " ".join(capsys.readouterr().out.split())
    assert "Damage: " in printed
    assert "byte" in printed
    assert "cut short" in printed


def test_exit_status_is_told_to_the_shell(bag, tmp_path):
    damaged = cut(bag, tmp_path / "cut")
    arguments = ["evaluate", "--methods", "zero", *SETTINGS]
    assert main.run([*arguments, str(bag), "--out", str(tmp_path / "good")]) == 0
    status = main.run([*arguments, str(damaged), "--out", str(tmp_path / "out")])
    assert status == evaluate.EXIT_INCOMPLETE == 3


def test_unreadable_recording_does_not_stop_the_others(bag, tmp_path, capsys):
    rubbish = tmp_path / "rubbish.mcap"
    rubbish.write_bytes(b"rubbish")
    status = mnsf(bag, rubbish, "--methods", "ego", "--out", tmp_path / "out")
    assert status == evaluate.EXIT_INCOMPLETE
    assert "rubbish.mcap" in "".join(capsys.readouterr().out.split())
    with pytest.raises(RecordingError, match="rubbish"):
        mnsf(rubbish, "--methods", "ego", "--out", tmp_path / "other")


@pytest.mark.parametrize("number", ["x", "1.5", ""])
def test_number_of_points_is_a_number_or_all(bag, tmp_path, capsys, number):
    with pytest.raises(SystemExit):
        mnsf(bag, "--num-points", number, "--out", tmp_path / "out")
    assert f"got {number!r}, expected a number or 'all'" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--methods", "mnfs"], "unknown method 'mnfs'; did you mean"),
        (["--methods", ","], "methods: got none"),
        (["--methods", "file:/nowhere"], "no such folder of predictions"),
        (["--set", "crop.max_range=3"], "unknown setting 'crop.max_range'"),
        (["--set", "crop.max_range_m"], "expected NAME=VALUE"),
        (["--points", "/lidar"], "no topic '/lidar'"),
        (["--num-points", "0"], "num_points: got 0"),
        (["--realtime", "-1"], "realtime rate: got -1.0"),
        (["--workers", "0"], "workers: got 0"),
        pytest.param(
            ["--ray", "127.0.0.1:9"],
            "no Ray cluster at '127.0.0.1:9'",
            marks=pytest.mark.skipif(find_spec("ray") is None, reason="Ray is not installed"),
        ),
    ],
)
def test_what_cannot_be_used_is_said_before_anything_is_written(bag, tmp_path, arguments, text):
    with pytest.raises(MnsfError) as caught:
        mnsf(bag, *arguments, "--out", tmp_path / "out")
    assert text in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_methods_with_more_frames_make_all_begin_later(bag, tmp_path):
    out = tmp_path / "out"
    assert mnsf(bag, "--methods", "zero,mnsf-frames5", "--out", out) == 0
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert [(row["method"], row["number"], row["failure"]) for row in rows] == [
        ("zero", 3, None),
        ("zero", 4, None),
        ("mnsf-frames5", 3, None),
        ("mnsf-frames5", 4, None),
    ]


def test_real_time_is_told_in_the_results(bag, tmp_path):
    assert mnsf(bag, "--methods", "zero", "--realtime", "0.5", "--out", tmp_path / "out") == 0
    text = (tmp_path / "out" / "results.md").read_text()
    assert "Replay at 0.5 times real time" in text
    assert "flag in the truth" in text


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("ground.remove=false", False),
        ("ground.remove=True", True),
        ("crop.max_range_m=35", 35.0),
        ("crop.max_range_m=3.5e1", 35.0),
        ("optimization.max_iterations=20", 20),
        ("distance.kind=tree", "tree"),
        (" distance.kind = grid ", "grid"),
    ],
)
def test_assignment_has_the_type_of_its_setting(text, value):
    (found,) = parse_assignments([text]).values()
    assert found == value
    assert type(found) is type(value)


@pytest.mark.parametrize(
    "text",
    [
        "ground.remove=1",
        "crop.max_range_m=far",
        "optimization.max_iterations=2.5",
        "distance.kind=",
    ],
)
def test_value_of_another_type_is_refused(text):
    with pytest.raises(SettingsError, match=text.split("=")[0]):
        parse_assignments([text])


def test_pair_is_scored_by_methods_that_make_do_with_two_sweeps(tmp_path, capsys):
    pair = small.write_recording(tmp_path / "pair", 2)
    out = tmp_path / "out"
    status = mnsf(pair, "--methods", "ego,fnsf,mnsf,mnsf-frames5", "--out", out)
    assert status == evaluate.EXIT_INCOMPLETE
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert [(row["method"], row["number"], bool(row["failure"])) for row in rows] == [
        ("ego", 0, False),
        ("fnsf", 0, False),
        ("mnsf", 0, False),
        ("mnsf-frames5", 0, True),
    ]
    assert rows[0]["errors"]["all"]["num_points"] > 0
    assert rows[2]["stop_reasons"].keys() == {"forward"}
    assert "mnsf-frames5: examples without a flow: 1" in " ".join(capsys.readouterr().out.split())


def test_recording_without_an_example_is_no_success(bag, tmp_path, capsys):
    single = small.write_recording(tmp_path / "single", 1)
    status = mnsf(bag, single, "--methods", "zero", "--out", tmp_path / "both")
    assert status == evaluate.EXIT_INCOMPLETE
    said = "No example: single contains no 2 consecutive sweeps"
    assert said in " ".join(capsys.readouterr().out.split())
    assert mnsf(single, "--methods", "zero", "--out", tmp_path / "one") == evaluate.EXIT_INCOMPLETE
    assert said in " ".join(capsys.readouterr().out.split())


def test_truth_that_is_nowhere_valid_is_told(tmp_path, capsys):
    """Of two sweeps the last has none, and the crop leaves no point of the first."""
    pair = small.write_recording(tmp_path / "pair", 2)
    arguments = ["--methods", "zero", "--set", "crop.min_range_m=70", "--out", tmp_path / "out"]
    assert mnsf(pair, *arguments) == 0
    printed = " ".join(capsys.readouterr().out.split())
    assert "pair: no scored point has valid truth" in printed


def test_method_that_fails_on_every_example_is_no_success(tmp_path, capsys):
    without = small.write_recording(tmp_path / "without", 4, with_odometry=False)
    assert mnsf(without, "--methods", "zero", "--out", tmp_path / "zero") == 0
    status = mnsf(without, "--methods", "zero,ego", "--out", tmp_path / "out")
    assert status == evaluate.EXIT_INCOMPLETE
    printed = " ".join(capsys.readouterr().out.split())
    assert "No flow: ego failed on every example of without: 2." in printed


def test_other_bag_of_the_same_name_is_not_resumed(tmp_path):
    one = small.write_recording(tmp_path / "a" / "drive", 4)
    other = small.write_recording(tmp_path / "b" / "drive", 4, num_points=61)
    out = tmp_path / "out"
    assert mnsf(one, "--methods", "zero", "--out", out) == 0
    before = {file: file.read_bytes() for file in out.iterdir()}
    with pytest.raises(EvaluationError, match="another recording 'drive': fingerprint"):
        mnsf(other, "--methods", "zero", "--out", out, "--resume")
    assert {file: file.read_bytes() for file in out.iterdir()} == before


def test_bag_of_the_same_name_can_be_added(tmp_path):
    one = small.write_recording(tmp_path / "a" / "drive", 4)
    other = small.write_recording(tmp_path / "b" / "drive", 5)
    out = tmp_path / "out"
    assert mnsf(one, "--methods", "zero", "--out", out) == 0
    assert mnsf(one, other, "--methods", "zero", "--out", out, "--resume") == 0
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert [row["recording"] for row in rows] == ["drive"] * 2 + [str(other)] * 3


def test_settings_that_need_more_memory_than_there_is_are_refused(
    bag, tmp_path, monkeypatch, capsys
):
    monkeypatch.setattr(memory_demand, "machine_bytes", lambda: 8 * 10**9)
    out = tmp_path / "out"
    sizes = ("field.num_hidden_layers=64", "field.hidden_width=4096", "compute.device=cpu")
    settings = [f"--set={size}" for size in sizes]
    arguments = ["evaluate", str(bag), "--methods", "fnsf", "--out", str(out), *settings]
    assert main.run(arguments) == main.EXIT_USAGE
    (line,) = capsys.readouterr().err.splitlines()
    assert re.search("need .* GB of memory, this machine has 8.0 GB: reduce field", line)
    assert not out.exists()


def test_same_bag_in_two_spellings_is_refused(bag, tmp_path, monkeypatch):
    monkeypatch.chdir(bag.parent)
    for other in (Path(bag.name), next(bag.glob("*.mcap"))):
        with pytest.raises(EvaluationError, match="is the same recording as"):
            mnsf(bag, other, "--methods", "zero", "--out", tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_each_finished_task_is_told_where_there_is_no_terminal(bag, tmp_path, capsys):
    assert mnsf(bag, "--methods", "zero,fnsf", "--out", tmp_path / "out") == 0
    printed = capsys.readouterr().out
    lines = [line for line in printed.splitlines() if " on drive: " in line]
    assert len(lines) == 2
    assert re.fullmatch(r"zero on drive: done, new examples: 4, \d+ ms each", lines[0])
    assert lines[1].startswith("fnsf on drive: done")
    assert printed.index(lines[1]) < printed.index("EPE (m)")


def shell(line, arguments, **environment):
    """Runs `mnsf evaluate` as a user's shell does; `line` has it as `"$@"`."""
    command = [sys.executable, "-m", "mnsf_ros.cli", "evaluate", *arguments, *SETTINGS]
    return subprocess.run(
        ["bash", "-c", line, "bash", *map(os.fsencode, map(str, command))],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        errors="backslashreplace",
        timeout=300,
        check=False,
    )


def test_reader_of_the_output_may_leave(bag, tmp_path):
    out = tmp_path / "out"
    arguments = [bag, "--methods=zero,ego", "--pictures=0", f"--out={out}"]
    done = shell('"$@" | head -1; exit ${PIPESTATUS[0]}', arguments)
    assert (done.returncode, done.stderr) == (0, "")
    assert len(done.stdout.splitlines()) == 1
    assert (out / "report.html").stat().st_size > 0
    assert len((out / "rows.jsonl").read_text().splitlines()) == 8


@pytest.mark.parametrize(
    "environment",
    [{}, {"LC_ALL": "C", "PYTHONUTF8": "0"}, {"PYTHONIOENCODING": "ascii"}],
    ids=["", "C", "ascii"],
)
@pytest.mark.parametrize("name", [b"bad\xff", "Straße 测试".encode()])
def test_path_that_is_no_text_costs_nothing(bag, tmp_path, environment, name):
    place = tmp_path / os.fsdecode(name)
    shutil.copytree(bag, place)
    out = tmp_path / "out"
    arguments = [place, "--methods=zero", "--pictures=1", f"--out={out}"]
    done = shell('"$@"', arguments, **environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert "no report" not in done.stdout
    assert "data:image/png" in (out / "report.html").read_text(encoding="utf-8")
    readable = name.decode(errors="backslashreplace")
    lines = (out / "rows.jsonl").read_text(encoding="utf-8").splitlines()
    assert {json.loads(line)["recording"] for line in lines} == {readable}
    assert readable in (out / "results.csv").read_text(encoding="utf-8")
    if environment:  # also where another locale reads it
        again = shell('"$@"', [*arguments, "--resume"])
        assert (again.returncode, again.stderr) == (0, "")
        assert len((out / "rows.jsonl").read_text(encoding="utf-8").splitlines()) == 4


def test_full_disk_is_told_and_resume_goes_on(bag, tmp_path):
    out = tmp_path / "out"
    arguments = [bag, "--methods=zero,ego", "--pictures=0", f"--out={out}"]
    done = shell('ulimit -f 6; "$@"', arguments)
    assert done.returncode == evaluate.EXIT_UNWRITTEN == 4
    message = r"mnsf: .*/out/\w+\.\w+: cannot be written: File too large\. .* --out \S+ --resume\n"
    assert re.fullmatch(message, done.stderr)
    assert shell('"$@"', [*arguments, "--resume"]).returncode == 0
    assert len((out / "rows.jsonl").read_text().splitlines()) == 8


def test_disk_that_is_full_from_the_start_leaves_no_folder(bag, tmp_path):
    out = tmp_path / "out"
    done = shell('ulimit -f 1; "$@"', [bag, "--methods=zero", f"--out={out}"])
    assert done.returncode == evaluate.EXIT_UNWRITTEN
    assert "run.json: cannot be written" in done.stderr
    assert not out.exists()


def test_pairs_of_a_recording_are_examples_when_asked_for(tmp_path):
    """Three pairs with gaps between them, as of single pairs that were converted together."""
    with BagWriter(tmp_path / "pairs") as writer:
        for index in (0, 1, 30, 31, 60, 61):
            points = small.xyz(index % 30)
            columns = {name: points[:, axis] for axis, name in enumerate("xyz")}
            encoded = encode_columns(columns, 1, len(points))
            writer.write_cloud("/points", encoded, small.stamp(index), "lidar")
    bag = tmp_path / "pairs"
    arguments = ["--methods", "zero,mnsf", "--out"]
    assert mnsf(bag, *arguments, tmp_path / "without") == evaluate.EXIT_INCOMPLETE
    assert mnsf(bag, "--pairs", *arguments, tmp_path / "with") == 0
    rows = [json.loads(line) for line in (tmp_path / "with/rows.jsonl").read_text().splitlines()]
    assert [(row["method"], row["number"]) for row in rows] == [
        *(("zero", number) for number in (0, 2, 4)),
        *(("mnsf", number) for number in (0, 2, 4)),
    ]


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="there is no full device")
def test_full_disk_under_the_output_costs_no_results(bag, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "mnsf_ros.cli", "evaluate", bag, "--methods", "zero"]
    with Path("/dev/full").open("w") as full:
        done = subprocess.run(
            [*command, *SETTINGS, "--pictures", "0", "--out", out],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=300,
            check=False,
        )
    assert done.returncode == 0
    assert done.stderr.count("the output cannot be written: No space left on device") == 1
    assert (out / "results.json").stat().st_size > 0
    assert (out / "report.html").stat().st_size > 0
