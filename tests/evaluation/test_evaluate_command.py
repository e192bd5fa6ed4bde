# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf evaluate` as users run it, on recordings that take a second."""

import csv
import json
import os
import re
import shutil
import signal
import subprocess
import sys
import time
from functools import partial

import pytest
import small_evaluations as small
from mcap.writer import Writer as McapWriter

from mnsf_ros.cli.main import run
from mnsf_ros.evaluation.parallel import run_serially
from mnsf_ros.evaluation.task import FinishedTask

# Those that start a process draw all the same.
pytestmark = pytest.mark.usefixtures("without_drawing")

SETTINGS = [f"--set={name}={value}" for name, value in small.TINY.items()]
COMPLETE, USAGE, STOPPED, INCOMPLETE, INTERRUPTED = 0, 2, 4, 5, 130


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 6)


class Ended:
    """A command that has ended: its status, and words of what it said."""

    def __init__(self, status, said):
        self.status, self.lines, self.errors = status, said.out.splitlines(), said.err.splitlines()
        self.out = " ".join(said.out.split())


@pytest.fixture
def mnsf(capsys):
    """Runs `mnsf evaluate` in this process."""

    def evaluate(*arguments, pictures=0):
        capsys.readouterr()
        status = run(["evaluate", *map(str, arguments), f"--pictures={pictures}", *SETTINGS])
        return Ended(status, capsys.readouterr())

    return evaluate


def rows_in(out):
    return [json.loads(line) for line in (out / "rows.jsonl").read_text("utf-8").splitlines()]


def content(folder):
    return {file: file.read_bytes() for file in folder.iterdir()}


def test_bag_in_table_and_report_out(bag, tmp_path, mnsf):
    out = tmp_path / "out"
    methods = "--methods=zero,ego,fnsf"
    ended = mnsf(bag, methods, "--num-points=30", f"--out={out}", pictures=1)
    assert ended.status == COMPLETE
    for text in ("EPE (m)", "mean over 4 examples", "Report: ", "ego on drive: done, examples: 4"):
        assert text in ended.out
    files = ("run.json", "results.md", "results.csv", "report.html")
    assert all((out / name).exists() for name in files)
    assert [row["method"] for row in rows_in(out)] == ["zero"] * 4 + ["ego"] * 4 + ["fnsf"] * 4
    assert "data:image/png" in (out / "report.html").read_text()


def test_both_forms_of_a_method_in_one_table_with_pictures(bag, tmp_path, mnsf):
    names = ["paper/fnsf", "mnsf/fnsf+optimization.max_iterations=2"]
    ended = mnsf(bag, f"--methods={','.join(names)}", f"--out={tmp_path / 'out'}", pictures=1)
    assert ended.status == COMPLETE
    rows = rows_in(tmp_path / "out")
    assert [row["method"] for row in rows] == [name for name in names for _ in range(4)]
    lines = (tmp_path / "out" / "results.csv").read_text().splitlines()
    assert all(any(f",{name}," in line for line in lines) for name in names)
    # A folder of pictures for each, not one in another.
    folders = list((tmp_path / "out" / "pictures").iterdir())
    assert len(folders) == len(names)
    assert all(file.is_file() for folder in folders for file in folder.iterdir())
    assert "data:image/png" in (tmp_path / "out" / "report.html").read_text()


def test_without_pytorch_the_default_is_what_robots_run(bag, tmp_path, mnsf, monkeypatch):
    monkeypatch.setitem(sys.modules, "torch", None)
    ended = mnsf(bag, "--out", tmp_path / "out")
    assert ended.status == COMPLETE
    assert re.search("mnsf is not evaluated: .*torch", ended.out)
    assert {row["method"] for row in rows_in(tmp_path / "out")} == {"online"}
    # Whoever names it is told what to install, and nothing is run.
    ended = mnsf(bag, "--methods=mnsf", "--out", tmp_path / "other")
    assert ended.status == USAGE
    assert "torch" in ended.errors[0]
    assert not (tmp_path / "other").exists()


# Names of plug-ins to their code, and to what is said of them.
PLUG_INS = {
    "fails-at-import": ("raise ValueError('no licence')", "ValueError: no licence"),
    "leaves-at-import": ("import sys; sys.exit(7)", "SystemExit: 7"),
    "fails-when-made": ("def Method(settings): return 1 / 0", "ZeroDivisionError"),
    "fails": ("def flow_of(points): raise RuntimeError('no GPU')", "RuntimeError: no GPU"),
    "leaves": ("import sys; flow_of = lambda points: sys.exit(7)", "SystemExit: 7"),
    "too-short": ("flow_of = lambda points: points[1:]", "flow of shape (59, 3)"),
    "nothing": ("flow_of = lambda points: None", "'NoneType'"),
}
PLUG_IN = """
import numpy as np
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import MethodTraits

class Method:
    traits = MethodTraits()

    def __init__(self, settings):
        self.settings = settings

    def renewed(self, settings):
        return Method(settings)

    def estimate(self, triplet, cancelled=None):
        points = triplet.current.xyz
        return FlowEstimate(flow_of(points), np.ones(len(points), bool))
"""


@pytest.fixture
def plug_ins(tmp_path, monkeypatch):
    """Installs a package with broken methods."""
    site = tmp_path / "site"
    (site / "broken-1.0.dist-info").mkdir(parents=True)
    lines = ["[mnsf_ros.methods]"]
    for number, (name, (code, _)) in enumerate(PLUG_INS.items()):
        (site / f"broken_{number}.py").write_text(f"{PLUG_IN}\n{code}\n")
        monkeypatch.delitem(sys.modules, f"broken_{number}", raising=False)
        lines.append(f"{name} = broken_{number}:Method")
    (site / "broken-1.0.dist-info" / "METADATA").write_text("Name: broken\nVersion: 1.0\n")
    (site / "broken-1.0.dist-info" / "entry_points.txt").write_text("\n".join(lines))
    monkeypatch.syspath_prepend(site)


@pytest.mark.usefixtures("plug_ins")
def test_broken_plug_in_costs_its_own_rows_and_one_line(bag, tmp_path, mnsf):
    out = tmp_path / "out"
    ended = mnsf(bag, f"--methods={','.join(PLUG_INS)},zero", "--out", out)
    assert ended.status == INCOMPLETE
    assert ended.errors == []
    for name, (_, text) in PLUG_INS.items():
        assert re.search(rf"\b{name}(:|' of broken:) .*?{re.escape(text)}", ended.out)
    good = [row["method"] for row in rows_in(out) if row["failure"] is None]
    assert good == ["zero"] * 4
    for name in ("fails-at-import", "leaves"):
        alone = mnsf(bag, f"--methods={name}", "--out", tmp_path / name)
        assert (alone.status, len(alone.errors)) in [(USAGE, 1), (INCOMPLETE, 0)]


@pytest.mark.parametrize(("preset_name", "method"), [("paper", "mnsf"), ("online", "online")])
def test_report_of_a_bag_without_truth_has_pictures(tmp_path, mnsf, preset_name, method):
    bag = small.write_recording(tmp_path / "bag", 6, with_truth=False, with_odometry=False)
    out = tmp_path / "out"
    arguments = [bag, f"--methods={method},zero", f"--preset={preset_name}", "--ground=settings"]
    ended = mnsf(*arguments, "--set=ground.remove=false", "--out", out, pictures=2)
    assert ended.status == COMPLETE
    text = (out / "report.html").read_text()
    assert text.count("data:image/png") == 2
    assert f"to the next sweep. {method}." in text


@pytest.mark.parametrize("error", [OSError("disk full"), ZeroDivisionError("a bug")])
def test_results_survive_a_report_that_fails(bag, tmp_path, mnsf, monkeypatch, error):
    def write_report(*_, **__):
        raise error

    monkeypatch.setattr("mnsf_ros.cli.evaluation.write_report", write_report)
    ended = mnsf(bag, "--methods=zero", "--out", tmp_path / "out")
    assert ended.status == INCOMPLETE
    assert "no report: " in ended.out
    assert (tmp_path / "out" / "results.md").stat().st_size > 0


def test_nothing_is_overwritten_and_resume_goes_on(bag, tmp_path, mnsf):
    out = tmp_path / "out"
    assert mnsf(bag, "--methods=zero", "--out", out).status == COMPLETE
    before = content(out)
    other = small.write_recording(tmp_path / "other" / "drive", 6, num_points=61)
    (tmp_path / "notes").mkdir()
    (tmp_path / "notes" / "text.txt").write_text("mine")
    for arguments, folder, text in (
        ([bag], out, "exists already; name another folder, or add --resume"),
        ([bag, "--resume", "--seed=3"], out, "other settings"),
        ([other, "--resume"], out, "another recording 'drive': fingerprint"),
        ([bag], tmp_path / "notes", "exists already"),
        ([bag, "--resume"], tmp_path / "notes", "holds no run"),
    ):
        ended = mnsf(*arguments, "--methods=zero", "--out", folder)
        assert ended.status == USAGE
        assert text in ended.errors[0]
    assert content(out) == before
    more = small.write_recording(tmp_path / "more", 4)
    assert mnsf(bag, more, "--methods=zero,ego", "--out", out, "--resume").status == COMPLETE
    found = [(row["recording"], row["method"]) for row in rows_in(out)]
    first = [("drive", "zero")] * 4 + [("drive", "ego")] * 4
    assert found == first + [("more", "zero")] * 2 + [("more", "ego")] * 2
    run = json.loads((out / "run.json").read_text())
    assert [len(run[name]) for name in ("recordings", "methods", "sessions")] == [2, 2, 2]


def test_without_a_folder_results_go_to_a_new_one(bag, tmp_path, mnsf, monkeypatch):
    monkeypatch.chdir(tmp_path)
    other = small.write_recording(tmp_path / "bags" / "other", 4)
    ended = mnsf(bag, "--methods", "zero", other)
    assert ended.status == COMPLETE
    (folder,) = (path for path in tmp_path.iterdir() if path.name != "bags")
    assert re.fullmatch(r"drive\+1-\d{8}-\d{6}", folder.name)
    assert f"Results folder: {folder.name}" in ended.lines
    assert [row["recording"] for row in rows_in(folder)] == ["drive"] * 4 + ["other"] * 2


@pytest.mark.parametrize("method", ["zero", "ego-estimated"])
def test_interruption_leaves_a_table_and_resume_does_the_rest(
    bag, tmp_path, mnsf, monkeypatch, method
):
    def run_until_interrupted(tasks, options):
        events = run_serially(tasks, options)
        for _ in range(6):
            yield next(events)
        raise KeyboardInterrupt

    arguments = [bag, f"--methods=ego,{method}", "--out", tmp_path / "out"]
    with monkeypatch.context() as patch:
        patch.setattr("mnsf_ros.evaluation.parallel.run_serially", run_until_interrupted)
        ended = mnsf(*arguments)
    assert ended.status == INTERRUPTED
    assert ended.errors == ["mnsf: interrupted"]
    page = (tmp_path / "out" / "results.md").read_text()
    for text in (ended.out, page):
        assert f"Unfinished: {method} on drive, examples so far: 1;" in text
        assert "over 1 to 4 examples" in text
    assert mnsf(*arguments, "--resume").status == COMPLETE
    assert len(rows_in(tmp_path / "out")) == 8


def test_damaged_recording_is_evaluated_as_far_as_it_goes(tmp_path, mnsf, monkeypatch):
    # A chunk for each message: what is in a chunk that is cut is lost.
    writer = partial(McapWriter, chunk_size=1)
    monkeypatch.setattr("mnsf_ros.recording.bag_writer.McapWriter", writer)
    damaged, out = small.write_recording(tmp_path / "cut", 6), tmp_path / "out"
    (file,) = damaged.glob("*.mcap")
    os.truncate(file, int(file.stat().st_size * 0.6))
    ended = mnsf(damaged, "--methods=ego", "--out", out)
    assert ended.status == INCOMPLETE
    assert 0 < len(rows_in(out)) < 4
    assert re.search("Damage: .*cut short", ended.out)


def test_unreadable_recording_does_not_stop_the_others(bag, tmp_path, mnsf):
    rubbish = tmp_path / "rubbish.mcap"
    rubbish.write_bytes(b"rubbish")
    ended = mnsf(bag, rubbish, "--methods=ego", "--out", tmp_path / "out")
    assert ended.status == INCOMPLETE
    assert "rubbish.mcap" in ended.out.replace(" ", "")
    ended = mnsf(rubbish, "--methods=ego", "--out", tmp_path / "other")
    assert ended.status == USAGE
    assert "rubbish" in ended.errors[0]


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["--methods=mnfs"], "unknown method 'mnfs'; did you mean"),
        (["--methods=,"], "methods: got none"),
        (["--methods=file:/nowhere"], "no such folder of predictions"),
        (["--set=crop.max_range=3"], "unknown setting 'crop.max_range'"),
        (["--set=crop.max_range_m"], "expected NAME=VALUE"),
        (["--set=crop.max_range_m=far"], "crop.max_range_m: got 'far'"),
        (["--set=ground.remove=1"], "ground.remove: got '1'"),
        (["--set=optimization.max_iterations=2.5"], "optimization.max_iterations: got 2.5"),
        (["--points=/lidar"], "no topic '/lidar'"),
        (["--num-points=-1"], "--num-points: got -1"),
        (["--realtime=0"], "--realtime: got 0, expected more"),
        (["--realtime=-1"], "--realtime: got -1,"),
        (["--workers=0"], "--workers: got '0'"),
        (["nowhere.mcap"], "nowhere.mcap: no such file"),
        (["--out=/proc/version"], "/proc/version: is not a folder"),
        (["--resume"], "--resume needs --out DIR"),
    ],
)
def test_unusable_argument_is_one_line_before_anything_is_written(
    bag, tmp_path, mnsf, monkeypatch, arguments, text
):
    monkeypatch.chdir(tmp_path)
    if not arguments[0].startswith("--methods"):
        arguments = [*arguments, "--methods=zero"]
    ended = mnsf(*([] if arguments[0].endswith(".mcap") else [bag]), *arguments)
    assert ended.status == USAGE
    (line,) = ended.errors
    assert text in line
    assert list(tmp_path.iterdir()) == []


def test_folder_that_cannot_be_made_stops_the_run(bag, mnsf):
    ended = mnsf(bag, "--methods=zero", "--out=/proc/results")
    assert ended.status == STOPPED
    assert ended.errors[0].startswith("mnsf: /proc/results: cannot be written: ")
    assert "--out /proc/results --resume" in ended.errors[0]


def test_all_methods_get_the_examples_of_the_one_with_most_sweeps(bag, tmp_path, mnsf):
    out = tmp_path / "out"
    assert mnsf(bag, "--methods=zero,mnsf-frames5", "--realtime=0.01", "--out", out).status == 0
    found = [(row["method"], row["number"], row["failure"]) for row in rows_in(out)]
    numbers = (3, 4)
    assert found == [(name, n, None) for name in ("zero", "mnsf-frames5") for n in numbers]
    text = (out / "results.md").read_text()
    assert "Replay at 0.01 times real time" in text
    assert "ground left out by the truth" in text


def test_pair_is_scored_by_methods_that_can_use_two_sweeps(tmp_path, mnsf):
    pair = small.write_recording(tmp_path / "pair", 2)
    out = tmp_path / "out"
    ended = mnsf(pair, "--methods=ego,mnsf,mnsf-frames5", "--out", out)
    assert ended.status == INCOMPLETE
    found = [(row["method"], row["number"], bool(row["failure"])) for row in rows_in(out)]
    assert found == [("ego", 0, False), ("mnsf", 0, False), ("mnsf-frames5", 0, True)]
    assert "mnsf-frames5: examples without a flow: 1" in ended.out


def test_pairs_of_a_recording_are_examples_when_asked_for(tmp_path, mnsf):
    """Three pairs with gaps between them, as of single pairs that were converted together."""
    bag = small.write_recording(tmp_path / "pairs", (0, 1, 30, 31, 60, 61), with_truth=False)
    arguments = ["--methods=zero,mnsf", "--out"]
    assert mnsf(bag, *arguments, tmp_path / "without").status == INCOMPLETE
    assert mnsf(bag, "--pairs", *arguments, tmp_path / "with").status == COMPLETE
    found = [(row["method"], row["number"]) for row in rows_in(tmp_path / "with")]
    assert found == [(method, number) for method in ("zero", "mnsf") for number in (0, 2, 4)]


def test_recording_without_an_example_is_no_success(bag, tmp_path, mnsf):
    single = small.write_recording(tmp_path / "single", 1)
    for bags, out in (([bag, single], "both"), ([single], "one")):
        ended = mnsf(*bags, "--methods=zero", "--out", tmp_path / out)
        assert ended.status == INCOMPLETE
        assert "No example: single contains no 2 consecutive sweeps" in ended.out


def test_task_that_fails_is_told(bag, tmp_path, mnsf, monkeypatch):
    def task_events(task, options):
        yield FinishedTask(*task.key, failure="the recording is gone")

    monkeypatch.setattr("mnsf_ros.evaluation.parallel.task_events", task_events)
    ended = mnsf(bag, "--methods=zero", "--out", tmp_path / "out")
    assert ended.status == INCOMPLETE
    assert "gave up zero on drive: the recording is gone" in ended.out


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


@pytest.mark.slow
@pytest.mark.parametrize(
    "environment",
    [{"LC_ALL": "C", "PYTHONUTF8": "0"}, {"PYTHONIOENCODING": "ascii"}],
    ids=["C", "ascii"],
)
@pytest.mark.parametrize("name", [b"bad\xff", "Straße 测试".encode()])
def test_path_that_is_no_text_costs_nothing(bag, tmp_path, environment, name):
    place = tmp_path / os.fsdecode(name)
    shutil.copytree(bag, place)
    out = tmp_path / "out"
    arguments = [place, "--methods=zero", "--pictures=1", f"--out={out}"]
    done = shell('"$@"', arguments, **environment)
    assert (done.returncode, done.stderr) == (0, "")
    assert "data:image/png" in (out / "report.html").read_text(encoding="utf-8")
    readable = name.decode(errors="backslashreplace")
    assert {row["recording"] for row in rows_in(out)} == {readable}
    assert readable in (out / "results.csv").read_text(encoding="utf-8")
    # Also where another locale reads it.
    again = shell('"$@"', [*arguments, "--resume"])
    assert (again.returncode, again.stderr) == (0, "")
    assert len(rows_in(out)) == 4


@pytest.mark.slow
def test_full_disk_is_told_and_resume_goes_on(bag, tmp_path):
    out = tmp_path / "out"
    arguments = [bag, "--methods=zero,ego", "--pictures=0", f"--out={out}"]
    for blocks, name in ((1, "run.json"), (6, r"\w+\.\w+")):
        done = shell(f'ulimit -f {blocks}; "$@"', [*arguments, "--resume"])
        assert done.returncode == STOPPED
        message = rf"mnsf: .*/out/{name}: cannot be written: File too large\. .* --out \S+ --resume"
        assert re.fullmatch(message, done.stderr.strip())
    assert shell('"$@"', [*arguments, "--resume"]).returncode == COMPLETE
    assert len(rows_in(out)) == 8


@pytest.mark.slow
def test_ctrl_c_with_workers_is_a_word_and_a_status(bag, tmp_path):
    """The terminal sends it to all processes."""
    out, begun, program = tmp_path / "out", tmp_path / "begun", tmp_path / "method.py"
    program.write_text(f"import time; open({str(begun)!r}, 'w'); time.sleep(300)")
    methods = [f"--methods=command:{sys.executable} {program}", "--methods=zero,ego"]
    command = [sys.executable, "-m", "mnsf_ros.cli", "evaluate", bag, *methods, *SETTINGS]
    with subprocess.Popen(
        [*command, "--workers=2", "--pictures=0", f"--out={out}"],
        stderr=subprocess.PIPE,
        start_new_session=True,
        # The parent of the tests may ignore it.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509
    ) as process:
        while not begun.exists():
            time.sleep(0.1)
        os.killpg(process.pid, signal.SIGINT)
        assert process.stderr.read() == b"mnsf: interrupted\n"
    assert process.returncode == INTERRUPTED
    found = subprocess.run(["pgrep", "-f", program], capture_output=True, check=False)
    assert found.stdout == b""


@pytest.mark.slow
def test_every_vehicle_of_the_street_of_the_readme_is_found(make_street, tmp_path):
    """Once, a crossing car of 600 points was lost for two seconds."""
    street = make_street(seed=0, duration_s=6.0, num_beams=64, num_columns=1900)
    out = str(tmp_path / "out")
    assert run(["evaluate", str(street), "--methods=online", "--pictures=0", "--out", out]) == 0
    with (tmp_path / "out" / "results.csv").open() as file:
        assert float(next(csv.DictReader(file))["fast_found"]) > 0.98
