# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How far `mnsf evaluate` is: a bar for each recording that is checked, and one for all tasks."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.markup import escape
from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)

from mnsf_ros.cli.console import Console
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.metrics import mean
from mnsf_ros.evaluation.options import EvaluationTask, TaskKey
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.task import TaskEvent, TaskFailed, TaskRestarted


@contextmanager
def checking_progress(console: Console, name: str) -> Iterator[Callable[[int, int], None]]:
    """Shows how much of a recording is read, and nothing when it is done."""
    columns = (
        TextColumn("checking {task.description}"),
        BarColumn(),
        DownloadColumn(),
        TimeRemainingColumn(),
    )
    is_shown = console.is_terminal
    with Progress(*columns, console=console, transient=True, disable=not is_shown) as progress:
        bar = progress.add_task(escape(name), total=None)
        yield lambda done, total: progress.update(bar, completed=done, total=total)


class _SweepRateColumn(ProgressColumn):
    """Sweeps per second, recently; a dash before there is any."""

    def render(self, task: Task) -> str:
        """Returns the text."""
        return f"{'-' if task.speed is None else f'{task.speed:.2f}'} sweeps/s"


class EvaluationProgress(Progress):
    """One bar for all tasks, counted in sweeps; elsewhere than on a terminal, a line for each."""

    def __init__(self, console: Console, runs: Sequence[EvaluationTask], every: int) -> None:
        """Starts at what is there already; only one of so many sweeps counts."""
        super().__init__(
            TextColumn("{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            _SweepRateColumn(),
            TimeRemainingColumn(),
            console=console,
        )
        self._lines = console
        self._every = every
        self._num_left = len(runs)
        self._times_ms: dict[TaskKey, dict[int, float]] = {run.key: {} for run in runs}
        self._done = Counter({run.key: len(run.skipped) for run in runs})
        total = sum(self._num_sweeps(run) for run in runs)
        self._bar = self.add_task(self._text(), total=total, completed=self._done.total())

    def watch(self, task: EvaluationTask, event: TaskEvent) -> None:
        """Takes notice of an event."""
        if isinstance(event, ResultRow):
            self._done[task.key] += 1
            # A task that was lost on the way may give a row again.
            self._times_ms[task.key][event.number] = event.time_ms
        elif isinstance(event, TaskRestarted):
            self._lines.say(f"{task_title(task.key)}: {event.reason}, again")
        elif isinstance(event, (Findings, TaskFailed)):
            if not self._lines.is_terminal:
                self._say_finished(task, is_done=isinstance(event, Findings))
            # The first and the last sweep of a recording make no example.
            self._done[task.key] = self._num_sweeps(task)
            self._num_left -= 1
        self.update(self._bar, completed=self._done.total(), description=self._text())

    def _num_sweeps(self, task: EvaluationTask) -> int:
        return -(-task.recording.num_sweeps // self._every)

    def _say_finished(self, task: EvaluationTask, *, is_done: bool) -> None:
        times_ms = self._times_ms[task.key]
        time_ms = mean(list(times_ms.values()))
        text = f"{task_title(task.key)}: {'done' if is_done else 'gave up'}"
        text += f", new examples: {len(times_ms)}"
        text += "" if math.isnan(time_ms) else f", {time_ms:.0f} ms each"
        self._lines.say(text, soft_wrap=True)

    def _text(self) -> str:
        return f"evaluating, tasks left: {self._num_left}" if self._num_left else "evaluated"


def task_title(key: TaskKey) -> str:
    """Returns what a task is called: method on recording."""
    return " on ".join(key[::-1])
