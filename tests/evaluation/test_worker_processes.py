# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tasks in processes of their own give what they give in this one, to the last digit."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
import small_evaluations as small

from mnsf_ros.evaluation.executors import MAX_ATTEMPTS, WorkerProcesses, run_serially
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.task import TaskFailed, TaskRestarted

METHODS = ("fnsf", "mnsf")


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    return small.write_recording(tmp_path_factory.mktemp("bags") / "drive", 6)


def events_by_task(execute, runs, options):
    events = {}
    for task, event in execute(runs, options):
        events.setdefault(task.key, []).append(event)
    return events


def comparable(events):
    return [
        small.without_times(event) if isinstance(event, ResultRow) else event for event in events
    ]


def test_workers_give_the_same_as_one_process(bag):
    options = small.options(num_points=40)
    runs = [small.task_at(bag, method) for method in METHODS]
    runs.append(replace(small.task_at(bag, "zero"), skipped=frozenset([2])))
    serial = events_by_task(run_serially, runs, options)
    parallel = events_by_task(WorkerProcesses(2), runs, options)
    assert parallel.keys() == serial.keys()
    for key, events in serial.items():
        assert comparable(parallel[key]) == comparable(events)
        assert isinstance(events[-1], Findings)


def test_task_that_cannot_be_done_does_not_stop_the_others(bag):
    runs = [small.task_at(bag, method) for method in ("nothing", "zero")]
    events = events_by_task(WorkerProcesses(1), runs, small.options())
    assert [type(event) for event in events["drive", "nothing"]] == [TaskFailed]
    assert "unknown method" in events["drive", "nothing"][0].reason
    assert isinstance(events["drive", "zero"][-1], Findings)


_OF_ITS_OWN = """
import sys
from pathlib import Path

if __name__ == "__main__":
    import small_evaluations as small
    from mnsf_ros.evaluation.executors import WorkerProcesses
    from mnsf_ros.evaluation.findings import Findings

    if sys.argv[2] == "torch":
        import torch
    tasks = [small.task_at(Path(sys.argv[1]), "zero")]
    *_, (_, last) = WorkerProcesses(1)(tasks, small.options())
    sys.exit(0 if isinstance(last, Findings) else repr(last))
"""


def evaluate_with_another_torch(folder, bag, torch, *arguments):
    """Runs a task by a worker, in a process of its own in which torch is a few lines."""
    (folder / "torch").mkdir()
    (folder / "torch" / "__init__.py").write_text(torch)
    script = folder / "of_its_own.py"
    script.write_text(_OF_ITS_OWN)
    here = Path(__file__).parent
    paths = os.pathsep.join(map(str, (folder, here, here.parents[1])))
    subprocess.run(
        [sys.executable, script, bag, *arguments],
        check=True,
        timeout=300,
        env=os.environ | {"PYTHONPATH": paths},
    )


def test_torch_is_loaded_only_for_networks(bag, tmp_path):
    """It takes seconds, in which Ctrl-C waits for the process that loads it."""
    found = tmp_path / "found"
    evaluate_with_another_torch(tmp_path, bag, f"open({str(found)!r}, 'w')", "no torch")
    assert not found.exists()


def test_server_of_processes_that_is_killed_is_started_again(bag, tmp_path):
    """It is killed while it imports torch, which the process that starts it has done before."""
    found, killed = tmp_path / "found", tmp_path / "killed"
    torch = f"""
import os, pathlib, signal
found, killed = map(pathlib.Path, {[str(found), str(killed)]!r})
if found.exists() and not killed.exists():
    killed.touch()
    os.kill(os.getpid(), signal.SIGKILL)
found.touch()
"""
    evaluate_with_another_torch(tmp_path, bag, torch, "torch")
    assert killed.exists()


class DiesOnce(frozenset):
    """Skips nothing; whoever comes to the second sweep is killed, as if no memory were left.

    That is in the process of a worker, which has sent the first row by then.
    """

    def __contains__(self, number):
        if number == 2:
            os.kill(os.getpid(), signal.SIGKILL)
        return super().__contains__(number)


class DiesAlways(DiesOnce):
    """Whoever takes the task over is killed, too."""

    def union(self, *others):
        return type(self)(super().union(*others))


class Waits(frozenset):
    """Whoever comes to the second sweep waits for ever."""

    def __contains__(self, number):
        if number == 2:
            signal.pause()
        return super().__contains__(number)


def test_process_that_dies_is_replaced_and_nothing_is_lost(bag):
    options = small.options()
    runs = [small.task_at(bag, "fnsf")]
    dying = [replace(runs[0], skipped=DiesOnce())]
    events = events_by_task(WorkerProcesses(1), dying, options)["drive", "fnsf"]
    kinds = [type(event) for event in events]
    assert kinds.count(TaskRestarted) == 1
    assert isinstance(events[-1], Findings)
    assert "ended with status -9" in next(e for e in events if isinstance(e, TaskRestarted)).reason
    rows = {event.number: event for event in events if isinstance(event, ResultRow)}
    serial = events_by_task(run_serially, runs, options)["drive", "fnsf"]
    expected = {event.number: event for event in serial if isinstance(event, ResultRow)}
    assert {number: small.without_times(row) for number, row in rows.items()} == {
        number: small.without_times(row) for number, row in expected.items()
    }
    # What had arrived was not computed again.
    assert len([event for event in events if isinstance(event, ResultRow)]) == len(expected)


def test_task_that_always_dies_is_given_up(bag):
    runs = [replace(small.task_at(bag, "fnsf"), skipped=DiesAlways())]
    events = events_by_task(WorkerProcesses(1), runs, small.options())["drive", "fnsf"]
    kinds = [type(event) for event in events]
    assert kinds.count(TaskRestarted) == MAX_ATTEMPTS - 1
    assert kinds[-1] is TaskFailed
    assert f"{MAX_ATTEMPTS} times" in events[-1].reason


def test_processes_are_gone_when_nobody_wants_more(bag):
    import multiprocessing

    runs = [replace(small.task_at(bag, method), skipped=Waits()) for method in METHODS]
    events = WorkerProcesses(2)(runs, small.options())
    next(events)
    assert multiprocessing.active_children()
    events.close()
    assert not multiprocessing.active_children()
