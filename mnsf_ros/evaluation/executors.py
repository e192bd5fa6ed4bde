# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Who runs the tasks: this process one after the other, or processes on this machine side by side.

`dispatched` is for all who run them elsewhere, see `ray_cluster.py`, too.
"""

from __future__ import annotations

import math
import multiprocessing
import signal
import sys
import time
from collections import deque
from collections.abc import Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from multiprocessing.connection import Connection, wait
from multiprocessing.process import BaseProcess
from typing import Any, Final, Protocol

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, TaskKey
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.task import TaskEvent, TaskFailed, TaskRestarted, task_events
from mnsf_ros.methods.registry import OPTIMIZER_MODULE

MAX_ATTEMPTS: Final = 3
_DYING_S: Final = 5.0
_DEAD_S: Final = 0.2


class Executor(Protocol):
    """Runs tasks, one after the other or side by side."""

    def __call__(
        self, tasks: Sequence[EvaluationTask], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        """Runs all tasks and yields what they give, as it gets ready.

        The last event of each task is its Findings, or TaskFailed.
        """
        ...


def run_serially(
    tasks: Sequence[EvaluationTask], options: EvaluationOptions
) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
    """Runs one task after the other in this process. An Executor."""
    for task in tasks:
        for event in task_events(task, options):
            yield task, event


@dataclass(frozen=True)
class Ended:
    """A worker ended; if it had not finished its task, the reason is told."""

    reason: str = ""


class Workers(Protocol):
    """What runs tasks elsewhere; a worker is known by a handle of any kind."""

    def start(self, task: EvaluationTask, options: EvaluationOptions) -> Hashable:
        """Starts a worker for a task."""
        ...

    def events(self, handles: list[Any]) -> Iterable[tuple[Hashable, TaskEvent | Ended]]:
        """Waits a little for what these workers give."""
        ...


def dispatched(
    tasks: Sequence[EvaluationTask],
    options: EvaluationOptions,
    workers: Workers,
    max_workers: float = math.inf,
) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
    """Runs tasks by workers, and those whose worker is lost again; yields what they give."""
    waiting = deque(tasks)
    working: dict[Hashable, EvaluationTask] = {}
    done: dict[TaskKey, set[int]] = {task.key: set() for task in tasks}
    finished: set[TaskKey] = set()
    while waiting or working:
        while waiting and len(working) < max_workers:
            task = waiting.popleft()
            working[workers.start(task, options)] = task
        for handle, event in workers.events(list(working)):
            # A worker that was taken for lost may still be writing.
            if handle not in working:
                continue
            task = working[handle]
            if not isinstance(event, Ended):
                if isinstance(event, ResultRow):
                    done[task.key].add(event.number)
                elif isinstance(event, (Findings, TaskFailed)):
                    finished.add(task.key)
                yield task, event
                continue
            del working[handle]
            if task.key in finished:
                continue
            if task.attempt + 1 < MAX_ATTEMPTS:
                waiting.append(task.again(done[task.key], options))
                yield task, TaskRestarted(event.reason)
            else:
                yield task, TaskFailed(f"{event.reason}, {MAX_ATTEMPTS} times")


class WorkerProcesses:
    """Runs tasks in processes; one that dies is replaced. An Executor."""

    def __init__(self, num_workers: int) -> None:
        """Says how many processes there are at a time."""
        self._num_workers = num_workers

    def __call__(
        self, tasks: Sequence[EvaluationTask], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        """Runs all tasks and yields what they give, as it gets ready."""
        processes = _Processes()
        try:
            yield from dispatched(tasks, options, processes, self._num_workers)
        finally:
            processes.stop_all()


class _Processes:
    """Workers, each known by the end of a pipe from which its events come."""

    def __init__(self) -> None:
        self._processes: dict[Connection, BaseProcess] = {}

    def start(self, task: EvaluationTask, options: EvaluationOptions) -> Connection:
        # Not fork: torch and CUDA do not survive it. The server has imported all that is slow,
        # and done nothing else, so that its children begin at once.
        context = multiprocessing.get_context("forkserver")
        context.set_forkserver_preload(_slow_imports())
        receiver, sender = context.Pipe(duplex=False)
        process = context.Process(target=_work, args=(sender, task, options), daemon=True)
        _start(process)
        # The end of the pipe is seen only when nobody else could write to it.
        sender.close()
        self._processes[receiver] = process
        return receiver

    def events(self, handles: list[Connection]) -> Iterator[tuple[Connection, TaskEvent | Ended]]:
        ready = wait(handles)
        for pipe in (pipe for pipe in handles if pipe in ready):
            try:
                yield pipe, pipe.recv()
            except (EOFError, OSError):
                process = self._processes[pipe]
                # What dies by itself has a status to be told.
                process.join(timeout=_DYING_S)
                if process.is_alive():
                    process.terminate()
                self._forget(pipe)
                yield pipe, Ended(f"its process ended with status {process.exitcode}")

    def stop_all(self) -> None:
        """Ends the processes that still run, all at the same time."""
        for process in self._processes.values():
            process.terminate()
        for pipe in list(self._processes):
            self._forget(pipe)

    def _forget(self, pipe: Connection) -> None:
        """Waits for one that was told to end."""
        process = self._processes.pop(pipe)
        pipe.close()
        process.join(timeout=_DYING_S)
        if process.is_alive():
            process.kill()
        process.join()


def _start(process: BaseProcess) -> None:
    """Starts a process, and the server that forks it again if that was killed meanwhile."""
    for attempt in range(MAX_ATTEMPTS):
        try:
            process.start()
            return
        except (EOFError, OSError) as error:
            if attempt + 1 == MAX_ATTEMPTS:
                raise EvaluationError(
                    f"worker processes cannot be started, tried {MAX_ATTEMPTS} times: {error}"
                ) from error
            # Until the system knows that it has ended; a busy one takes its time.
            time.sleep(_DEAD_S * 10**attempt)


def _slow_imports() -> list[str]:
    """Modules that tasks need; torch imports its own slow one with the first optimizer."""
    # Who made the tasks has asked each method for its traits: one with networks imports torch.
    return [task_events.__module__, *([OPTIMIZER_MODULE] if "torch" in sys.modules else [])]


def _work(events: Connection, task: EvaluationTask, options: EvaluationOptions) -> None:
    # Ctrl-C goes to all processes of the terminal; the parent ends this one when it is time, and
    # then what is half written is to be taken away.
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        for event in task_events(task, options):
            events.send(event)
    except (BrokenPipeError, KeyboardInterrupt):
        return
    finally:
        events.close()
