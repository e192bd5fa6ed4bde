# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The folder of a run: what is run, its rows, and what was noticed, written as it comes.

`run.json` says what is run, `rows.jsonl` has one row per line, in the order in which they got
ready, `tasks.jsonl` one line per finished task. The last two only ever grow while a run lasts, so
that an interruption costs nothing but the line being written.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import replace
from itertools import product
from pathlib import Path

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import flow_path
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, TaskKey
from mnsf_ros.evaluation.recordings import path_text
from mnsf_ros.evaluation.results import FinishedTask, ResultRow
from mnsf_ros.evaluation.run_files import (
    ROWS_FILE,
    RUN_FILE,
    TASKS_FILE,
    append_line,
    check_folder,
    cut_off_unfinished_line,
    holds_something,
    locked,
    read_json,
    read_lines,
    remove_if_unused,
    replace_file,
    writing,
)
from mnsf_ros.evaluation.run_json import to_json
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.shown_flows import PICTURES_FOLDER, ShownFlow, ShownFlows
from mnsf_ros.evaluation.task import TaskEvent, TaskRestarted


class RunFolder:
    """Reads the files of a run, and adds to them: `opened`, `begin`, `take`.

    Whatever reads raises an EvaluationError if a file is missing or damaged; whatever writes raises
    a WritingError if that fails.

    Attributes:
        path: The folder.
        before: The record of the run that was there when the folder was opened; None if none.
        flows: The flows that a report shows.
        anew: Tasks of a resumed run that start again, because they cannot go on in the middle.
    """

    def __init__(self, path: Path) -> None:
        """Names a folder, to read what is there; `opened` is for a run that goes on."""
        self.path = path
        self.before: RunRecord | None = None
        self.flows = ShownFlows(path)
        self.anew: frozenset[TaskKey] = frozenset()
        self._rows, self._tasks = path / ROWS_FILE, path / TASKS_FILE
        self._session = ExitStack()
        self._num_pictured = 0
        self._done: dict[TaskKey, set[int]] = {}
        self._indivisible: frozenset[TaskKey] = frozenset()

    @contextmanager
    def opened(self, *, resume: bool) -> Iterator[RunFolder]:
        """Opens a new folder, or a run to resume. Nothing is written before `begin`.

        Raises:
            EvaluationError: The folder holds something and `resume` is not set, or no run, or it
                is none.
        """
        check_folder(self.path, resume=resume)
        if holds_something(self.path):
            self.before = self.read_record()
        with self._session:
            yield self

    def begin(self, record: RunRecord) -> list[EvaluationTask]:
        """Writes down what is run from now on; returns the tasks that are left to do.

        No other process can write to the folder until it is closed; then it is taken away if
        nothing was done. A resumed run may have more recordings and methods.

        Raises:
            EvaluationError: The folder holds a run with other settings or another recording of the
                same name, which must not be mixed with this one; or another process is at it.
        """
        whole, self._num_pictured = record, record.options.num_pictured
        if self.before is not None:
            whole = record.resuming(self.before, self.path)
        self._session.enter_context(locked(self.path))
        file = self.path / RUN_FILE
        if self.before != (read_json(file, RunRecord) if holds_something(self.path) else None):
            raise EvaluationError(f"{self.path}: another process has just written to it")
        self._session.callback(remove_if_unused, self.path)
        if self.before is not None:
            for lines in (self._rows, self._tasks):
                cut_off_unfinished_line(lines)
        replace_file(file, [to_json(whole, indent=2), "\n"])
        return self._left(record)

    def _left(self, record: RunRecord) -> list[EvaluationTask]:
        """The tasks that are left to do, also those whose flow is wanted now but was not written.

        Rows of a task that was interrupted and cannot go on in the middle are taken away.
        """
        options, finished, numbers = record.options, self.finished(), self.numbers()
        tasks = [EvaluationTask(*pair) for pair in product(record.recordings, record.methods)]
        left = [task for task in tasks if task.key not in finished or not _has_flow(task, options)]
        self._indivisible = frozenset(
            task.key for task in left if options.is_indivisible(task.method)
        )
        self.flows.drop(self._indivisible)
        self.anew = self._indivisible & numbers.keys()
        if self.anew:
            self.drop(self.anew)
        self._done = {
            task.key: set() if task.key in self.anew else numbers.get(task.key, set())
            for task in left
        }
        return [replace(task, skipped=frozenset(self._done[task.key])) for task in left]

    def take(self, task: EvaluationTask, event: TaskEvent) -> None:
        """Writes down what a task gave."""
        done = self._done[task.key]
        if isinstance(event, ResultRow):
            # A second attempt may give a row again that the first one got ready before it was lost.
            if event.number not in done:
                self.add_row(event)
                done.add(event.number)
        elif isinstance(event, ShownFlow):
            with writing(self.path / PICTURES_FOLDER):
                self.flows.add(event, self._num_pictured)
        elif isinstance(event, Findings):
            counts = {kind.value: count for kind, count in event.counts.items()}
            damages = [path_text(str(damage)) for damage in event.damages]
            append_line(self._tasks, FinishedTask(*task.key, len(done), counts, damages))
        elif isinstance(event, TaskRestarted) and task.key in self._indivisible:
            self.flows.drop({task.key})
            if done:
                self.drop({task.key})
                done.clear()

    @property
    def rows(self) -> Iterator[ResultRow]:
        """All rows, in the order in which they got ready."""
        return read_lines(self._rows, ResultRow)

    @property
    def has_results(self) -> bool:
        """Whether anything was done yet."""
        return self._rows.exists() or self._tasks.exists()

    def numbers(self) -> dict[TaskKey, set[int]]:
        """Returns the numbers of the sweeps of all rows, by recording and method."""
        numbers: dict[TaskKey, set[int]] = {}
        for row in self.rows:
            numbers.setdefault((row.recording, row.method), set()).add(row.number)
        return numbers

    def finished(self) -> dict[TaskKey, FinishedTask]:
        """Returns recording and method of each finished task, and what was noticed."""
        tasks = read_lines(self._tasks, FinishedTask)
        return {(task.recording, task.method): task for task in tasks}

    def read_record(self) -> RunRecord:
        """Returns what was run."""
        if not (self.path / RUN_FILE).exists():
            raise EvaluationError(f"{self.path}: holds no run, {RUN_FILE} is missing")
        return read_json(self.path / RUN_FILE, RunRecord)

    def add_row(self, row: ResultRow) -> None:
        """Adds a row."""
        append_line(self._rows, row)

    def drop(self, keys: Collection[TaskKey]) -> None:
        """Takes the rows of some tasks away."""
        rows = (row for row in self.rows if (row.recording, row.method) not in keys)
        replace_file(self._rows, (f"{to_json(row)}\n" for row in rows))


def _has_flow(task: EvaluationTask, options: EvaluationOptions) -> bool:
    """Whether the recording of a task's flow is there, or nobody wants it."""
    path = flow_path(options.flow_folder, *task.key)
    return path is None or path.exists()
