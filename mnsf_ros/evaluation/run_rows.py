"""The rows of a run: those that are there, the tasks that are left, and writing what these give.

`rows.jsonl` has one row per line, in the order in which they got ready; `tasks.jsonl` one line per
finished task, with what was noticed. Both only ever grow while a run lasts, so that an interruption
costs nothing but the line being written.
"""

from __future__ import annotations

import fcntl
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.executors import Executor, run_serially
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import flow_path
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions, EvaluationTask, TaskKey
from mnsf_ros.evaluation.recordings import EvaluatedRecording, path_text
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_files import replace_file, writing
from mnsf_ros.evaluation.run_json import Kind, from_json, to_json
from mnsf_ros.evaluation.task import TaskEvent, TaskFailed, TaskRestarted

LOCK_FILE: Final = ".lock"
EventWatcher = Callable[[EvaluationTask, TaskEvent], None]


class RunRows:
    """Reads and writes the rows and finished tasks in the folder of a run.

    Whatever reads raises an EvaluationError if a file is damaged; whatever writes raises a
    WritingError if that fails.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._rows = folder / "rows.jsonl"
        self._tasks = folder / "tasks.jsonl"

    def __iter__(self) -> Iterator[ResultRow]:
        """Yields all rows, in the order in which they got ready."""
        return _parsed(self._rows, ResultRow)

    def numbers(self) -> dict[TaskKey, set[int]]:
        """Returns the numbers of the sweeps of all rows, by recording and method."""
        numbers: dict[TaskKey, set[int]] = {}
        for row in self:
            numbers.setdefault((row.recording, row.method), set()).add(row.number)
        return numbers

    def finished(self) -> dict[TaskKey, FinishedTask]:
        """Returns recording and method of each finished task, and what was noticed."""
        tasks = _parsed(self._tasks, FinishedTask)
        return {(task.recording, task.method): task for task in tasks}

    def append(self, row: ResultRow) -> None:
        """Adds a row."""
        _append(self._rows, row)

    def append_finished(self, key: TaskKey, findings: Findings, num_examples: int) -> None:
        """Adds a finished task."""
        counts = {event.value: count for event, count in findings.counts.items()}
        damages = [path_text(str(damage)) for damage in findings.damages]
        _append(self._tasks, FinishedTask(*key, num_examples, counts, damages))

    def drop(self, keys: Iterable[TaskKey]) -> None:
        """Takes the rows of some tasks away."""
        dropped = set(keys)
        rows = (row for row in self if (row.recording, row.method) not in dropped)
        replace_file(self._rows, (f"{to_json(row)}\n" for row in rows))

    def cut_off_unfinished_lines(self) -> None:
        """Takes away what was being written when a run was killed."""
        for file in (self._rows, self._tasks):
            replace_file(file, (f"{line}\n" for line in _lines(file)))

    @contextmanager
    def locked(self) -> Iterator[None]:
        """Keeps other processes from writing to the same folder; an EvaluationError if one does."""
        with (self._folder / LOCK_FILE).open("a", encoding="utf-8") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError as error:
                raise EvaluationError(
                    f"{self._folder}: another process is writing to it"
                ) from error
            yield


def _parsed(file: Path, kind: type[Kind]) -> Iterator[Kind]:
    number = 0
    try:
        for line in _lines(file):
            number += 1
            yield from_json(line, kind)
    except EvaluationError as error:
        raise EvaluationError(f"{file}, line {number}: {error}") from error


def _lines(file: Path) -> Iterator[str]:
    """The complete lines of a file; a last one without an end was being written and is lost."""
    try:
        # One at a time: the rows of many recordings are too much for the memory.
        with file.open(encoding="utf-8", newline="\n") as stream:
            for line in stream:
                if line.endswith("\n"):
                    yield line[:-1]
    except FileNotFoundError:
        return
    except (OSError, ValueError) as error:
        raise EvaluationError(f"{file}: cannot be read: {error}") from error


def _append(file: Path, value: object) -> None:
    line = to_json(value)
    with writing(file), file.open("a", encoding="utf-8", errors="backslashreplace") as stream:
        stream.write(f"{line}\n")


def plan_runs(
    recordings: Sequence[EvaluatedRecording],
    methods: Sequence[EvaluatedMethod],
    options: EvaluationOptions,
    rows: RunRows,
) -> list[EvaluationTask]:
    """Returns the tasks that are left to do.

    A finished task whose flow is wanted now, but was not written, is left to do, too. Rows of a
    task that was interrupted and cannot go on in the middle are taken away.

    Raises:
        EvaluationError: The files of the run are damaged.
    """
    finished = rows.finished()
    numbers = rows.numbers()
    tasks = [EvaluationTask(recording, method) for recording in recordings for method in methods]
    left = [task for task in tasks if task.key not in finished or not _has_flow(task, options)]
    anew = [
        task.key for task in left if task.key in numbers and options.is_indivisible(task.method)
    ]
    if anew:
        with rows.locked():
            rows.drop(anew)
        numbers = {key: done for key, done in numbers.items() if key not in anew}
    return [replace(task, skipped=frozenset(numbers.get(task.key, ()))) for task in left]


def _has_flow(task: EvaluationTask, options: EvaluationOptions) -> bool:
    """Whether the recording of a task's flow is there, or nobody wants it."""
    path = flow_path(options.flow_folder, *task.key)
    return path is None or path.exists()


def run_evaluation(
    tasks: Sequence[EvaluationTask],
    options: EvaluationOptions,
    rows: RunRows,
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
    with rows.locked():
        for task, event in execute(tasks, options):
            _write(task, event, options, rows, done[task.key])
            if isinstance(event, TaskFailed):
                failed[task.key] = event.reason
            watch(task, event)
    return failed


def _write(
    task: EvaluationTask,
    event: TaskEvent,
    options: EvaluationOptions,
    rows: RunRows,
    done: set[int],
) -> None:
    if isinstance(event, ResultRow):
        # A second attempt may give a row again that the first one got ready before it was lost.
        if event.number not in done:
            rows.append(event)
            done.add(event.number)
    elif isinstance(event, Findings):
        rows.append_finished(task.key, event, len(done))
    elif isinstance(event, TaskRestarted) and options.is_indivisible(task.method) and done:
        rows.drop([task.key])
        done.clear()
