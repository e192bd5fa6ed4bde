"""How far an evaluation is, on the terminal."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from mnsf_ros.evaluation.evaluation_options import EvaluationTask
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.task_runs import TaskEvent, TaskFailed, TaskRestarted, TaskRun


class _SweepRateColumn(TextColumn):
    """Sweeps per second, recently."""

    def __init__(self) -> None:
        super().__init__("")

    def render(self, task: Task) -> Text:
        """Returns the rate, or a dash before there is one."""
        return Text("- sweeps/s" if task.speed is None else f"{task.speed:.2f} sweeps/s")


class EvaluationProgress:
    """One bar for all tasks, counted in sweeps."""

    def __init__(self, progress: Progress, runs: Sequence[TaskRun]) -> None:
        """Starts at what is there already."""
        self._progress = progress
        self._num_left = len(runs)
        self._done = Counter({run.task.key: len(run.skipped) for run in runs})
        total = sum(run.task.recording.num_sweeps for run in runs)
        self._bar = progress.add_task(self._text(), total=total, completed=self._done.total())

    def watch(self, task: EvaluationTask, event: TaskEvent) -> None:
        """Takes notice of an event."""
        if isinstance(event, ResultRow):
            self._done[task.key] += 1
        elif isinstance(event, TaskRestarted):
            self._progress.console.print(f"{' with '.join(task.key[::-1])}: {event.reason}, again")
        elif isinstance(event, (Findings, TaskFailed)):
            # The first and the last sweep of a recording make no example.
            self._done[task.key] = task.recording.num_sweeps
            self._num_left -= 1
        self._progress.update(self._bar, completed=self._done.total(), description=self._text())

    def _text(self) -> str:
        return f"evaluating, tasks left: {self._num_left}" if self._num_left else "evaluated"


@contextmanager
def evaluation_progress(console: Console, runs: Sequence[TaskRun]) -> Iterator[EvaluationProgress]:
    """Shows a bar with the sweeps done, their rate and the time left."""
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _SweepRateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield EvaluationProgress(progress, runs)
