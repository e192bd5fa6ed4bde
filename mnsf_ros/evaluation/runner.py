"""Running all tasks of an evaluation and writing down what they give."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Hashable, Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, Protocol

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import flow_path
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions, EvaluationTask, TaskKey
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.task import run_task

MAX_ATTEMPTS: Final = 3


@dataclass(frozen=True)
class TaskFailed:
    """A task gave up; why, in one line."""

    reason: str


@dataclass(frozen=True)
class TaskRestarted:
    """A task begins anew, because the process or machine that ran it was lost."""

    reason: str


TaskEvent = ResultRow | Findings | TaskFailed | TaskRestarted


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


def task_events(task: EvaluationTask, options: EvaluationOptions) -> Iterator[TaskEvent]:
    """Yields the events of one task; an error of ours becomes TaskFailed."""
    try:
        yield from run_task(task, options)
    except MnsfError as error:
        yield TaskFailed(str(error))


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


EventWatcher = Callable[[EvaluationTask, TaskEvent], None]


def plan_runs(
    recordings: Sequence[EvaluatedRecording],
    methods: Sequence[EvaluatedMethod],
    options: EvaluationOptions,
    folder: RunFolder,
) -> list[EvaluationTask]:
    """Returns the tasks that are left to do.

    A finished task whose flow is wanted now, but was not written, is left to do, too. Rows of a
    task that was interrupted and cannot go on in the middle are taken away.

    Raises:
        EvaluationError: The files of the run are damaged.
    """
    finished = folder.read_finished()
    numbers = folder.numbers()
    tasks = [EvaluationTask(recording, method) for recording in recordings for method in methods]
    left = [task for task in tasks if task.key not in finished or not _has_flow(task, options)]
    anew = [
        task.key for task in left if task.key in numbers and options.is_indivisible(task.method)
    ]
    if anew:
        with folder.locked():
            folder.drop_rows_of(anew)
        numbers = {key: done for key, done in numbers.items() if key not in anew}
    return [replace(task, skipped=frozenset(numbers.get(task.key, ()))) for task in left]


def _has_flow(task: EvaluationTask, options: EvaluationOptions) -> bool:
    """Whether the recording of a task's flow is there, or nobody wants it."""
    path = flow_path(options.flow_folder, *task.key)
    return path is None or path.exists()


def run_evaluation(
    tasks: Sequence[EvaluationTask],
    options: EvaluationOptions,
    folder: RunFolder,
    *,
    execute: Executor = run_serially,
    watch: EventWatcher = lambda task, event: None,
) -> dict[TaskKey, str]:
    """Runs tasks and writes each row as soon as it is there.

    `watch` gets every event, after it was written down.

    Returns:
        Recording and method of each task that gave up, and why.

    Raises:
        EvaluationError: Another process is writing to the same folder.
        OSError: Writing fails.
    """
    failed: dict[TaskKey, str] = {}
    done = {task.key: set(task.skipped) for task in tasks}
    with folder.locked():
        for task, event in execute(tasks, options):
            _write(task, event, options, folder, done[task.key])
            if isinstance(event, TaskFailed):
                failed[task.key] = event.reason
            watch(task, event)
    return failed


def _write(
    task: EvaluationTask,
    event: TaskEvent,
    options: EvaluationOptions,
    folder: RunFolder,
    done: set[int],
) -> None:
    if isinstance(event, ResultRow):
        # A second attempt may give a row again that the first one got ready before it was lost.
        if event.number not in done:
            folder.append_row(event)
            done.add(event.number)
    elif isinstance(event, Findings):
        folder.append_finished(task.key, event, len(done))
    elif isinstance(event, TaskRestarted) and options.is_indivisible(task.method) and done:
        folder.drop_rows_of([task.key])
        done.clear()
