# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tasks in processes and on a Ray cluster give the same as in this process, to the last digit."""

import importlib.util
import json
import os
import signal
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path

import pytest
import small_evaluations as small

from mnsf_ros.cli import main
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.parallel import executor, run_serially
from mnsf_ros.evaluation.scoring import ResultRow

needs_ray = [
    pytest.mark.slow,
    pytest.mark.skipif(importlib.util.find_spec("ray") is None, reason="Ray is not installed"),
    # Ray's own code warns of this and that.
    pytest.mark.filterwarnings("ignore"),
]


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 6, num_points=400)


def events_by_task(execute, tasks, options):
    events = {}
    for task, event in execute(tasks, options):
        is_row = isinstance(event, ResultRow)
        events.setdefault(task.key, []).append(small.without_times(event) if is_row else event)
    return events


@pytest.mark.parametrize(
    "where",
    [{"num_workers": 2}, pytest.param({"ray_address": "local"}, marks=needs_ray)],
    ids=["processes", "ray"],
)
def test_events_are_the_same_wherever_tasks_run(bag, where):
    options = small.options(num_points=40)
    tasks = [small.task_at(bag, method) for method in ("online", "nothing", "zero")]
    serial = events_by_task(run_serially, tasks, options)
    with executor(**where) as execute:
        parallel = events_by_task(execute, tasks, options)
    assert parallel == serial
    assert [events[-1].failure for events in serial.values()].count(None) == 2
    (failed,) = serial["drive", "nothing"]
    assert "unknown method" in failed.failure


@pytest.mark.slow
def test_run_of_a_killed_worker_is_resumed(bag, tmp_path, capsys, monkeypatch):
    """The command that runs into it ends with a line, and with status 4."""
    out = tmp_path / "out"
    script = tmp_path / "method.py"
    script.write_text("import os, signal; os.kill(os.getppid(), signal.SIGKILL)")
    settings = [f"--set={name}={value}" for name, value in small.TINY.items()]
    arguments = [bag, f"--methods=command:{sys.executable} {script}", "--methods=zero,ego"]
    arguments += ["--workers=2", f"--out={out}", "--pictures=0", *settings]
    assert main.run(["evaluate", *map(str, arguments)]) == 4
    said = capsys.readouterr().err
    assert said.startswith("mnsf: a worker was lost")
    assert said.count("\n") == 1
    assert said.endswith(f"repeat the command with --out {out} --resume\n")
    rows = out / "rows.jsonl"
    number = len(rows.read_text().splitlines()) if rows.exists() else 0
    script.write_text("import sys, numpy as np; np.save(sys.argv[3], np.load(sys.argv[1]) * 0)")
    assert main.run(["evaluate", *map(str, arguments), "--resume"]) == 0
    rows = [json.loads(line) for line in (out / "rows.jsonl").read_text().splitlines()]
    assert number in (0, 4, 8)
    assert len({(row["method"], row["number"]) for row in rows}) == len(rows) == 12


@pytest.mark.slow
def test_workers_end_when_the_driver_is_killed(bag, tmp_path):
    begun, program = tmp_path / "begun", tmp_path / "method.py"
    code = f"import os, time; open({str(begun)!r}, 'w').write(str(os.getpid())); time.sleep(300)"
    program.write_text(code)
    command = [sys.executable, "-m", "mnsf_ros.cli", "evaluate", bag, "--methods=zero,ego"]
    command += [f"--methods=command:{sys.executable} {program}", "--workers=2"]
    with subprocess.Popen([*command, f"--out={tmp_path / 'out'}"]) as process:
        while not (begun.exists() and begun.read_text()):
            time.sleep(0.1)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
        process.kill()
    give_up = time.monotonic() + 60
    while any(map(is_running, children)) and time.monotonic() < give_up:
        time.sleep(0.1)
    still_there = list(filter(is_running, children))
    # The program of the worker goes on without it.
    os.kill(int(begun.read_text()), signal.SIGKILL)
    assert len(children) >= 2
    assert still_there == []


def is_running(pid):
    """Whether there is such a process; one that nobody has waited for is none."""
    with suppress(OSError):
        return "\nState:\tZ" not in Path(f"/proc/{pid}/status").read_text()
    return False


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        ({"num_gpus": -1}, "num_gpus: got -1"),
        ({"num_workers": 2, "ray_address": "local"}, "--workers cannot be combined with --ray"),
    ],
)
def test_numbers_that_cannot_be_used_are_refused(arguments, text):
    with pytest.raises(EvaluationError, match=text):
        executor(**arguments)


def test_ray_is_optional(monkeypatch):
    monkeypatch.setitem(sys.modules, "ray", None)
    with pytest.raises(ModuleNotFoundError, match="ray"):
        executor(ray_address="local")


class TestRay:
    pytestmark = needs_ray

    def test_task_whose_node_is_lost_is_tried_again(self, bag):
        import ray
        from ray.cluster_utils import Cluster

        memory = 80 * 2**20
        head = {"num_cpus": 1, "include_dashboard": False, "object_store_memory": memory}
        cluster = Cluster(initialize_head=True, head_node_args=head)
        try:
            node = cluster.add_node(num_cpus=1, object_store_memory=memory)
            # Long enough for a node to be killed in the middle of a task.
            options = small.options({"optimization.max_iterations": 2000, "field.hidden_width": 64})
            tasks = [small.task_at(bag, method) for method in ("zero", "fnsf", "mnsf", "nsfp")]
            expected = events_by_task(run_serially, tasks, options)
            events = {}
            with executor(ray_address=cluster.address) as execute:
                for task, event in execute(tasks, options):
                    if not events:
                        cluster.remove_node(node, allow_graceful=False)
                    is_row = isinstance(event, ResultRow)
                    known = events.setdefault(task.key, [])
                    known.append(small.without_times(event) if is_row else event)
            assert events == expected
        finally:
            ray.shutdown()
            cluster.shutdown()

    def test_clusters_that_cannot_be_used(self, bag):
        with (
            pytest.raises(EvaluationError, match="no Ray cluster at '127"),
            executor(ray_address="127.0.0.1:1"),
        ):
            pass
        tasks = [small.task_at(bag, "zero")]
        with (
            executor(ray_address="local", num_gpus=1000) as execute,
            pytest.raises(EvaluationError, match="what a task needs: 1 CPU, 1000 GPU"),
        ):
            list(execute(tasks, small.options()))
