"""What an evaluation prints on its way: a bar on a terminal, elsewhere a line for each task."""

from __future__ import annotations

import math
import os
import sys
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager

from rich.console import Console
from rich.markup import escape
from rich.progress import (
    BarColumn,
    DownloadColumn,
    MofNCompleteColumn,
    Progress,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationTask, TaskKey
from mnsf_ros.evaluation.results import ResultRow, mean
from mnsf_ros.evaluation.runner import TaskEvent, TaskFailed, TaskRestarted


class PatientConsole(Console):
    """Prints to the standard output until nobody reads it any more, as after `| head -1`."""

    def on_broken_pipe(self) -> None:
        """Prints nothing from now on, where rich would end the process."""
        self.quiet = True
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)

    def _check_buffer(self) -> None:
        """Writes; versions of rich before 13.8, as Ubuntu 24.04 has, do not ask what to do then."""
        try:
            super()._check_buffer()
        except BrokenPipeError:
            self.on_broken_pipe()
        except OSError as error:
            print(f"mnsf: the output cannot be written: {error.strerror}", file=sys.stderr)
            self.on_broken_pipe()


class _SweepRateColumn(TextColumn):
    """Sweeps per second, recently."""

    def __init__(self) -> None:
        super().__init__("")

    def render(self, task: Task) -> Text:
        """Returns the rate, or a dash before there is one."""
        return Text("- sweeps/s" if task.speed is None else f"{task.speed:.2f} sweeps/s")


class EvaluationProgress:
    """One bar for all tasks, counted in sweeps."""

    def __init__(self, progress: Progress, runs: Sequence[EvaluationTask], every: int) -> None:
        """Starts at what is there already."""
        self._every = every
        self._progress = progress
        self._num_left = len(runs)
        self._times_ms: dict[TaskKey, dict[int, float]] = {run.key: {} for run in runs}
        self._done = Counter({run.key: len(run.skipped) for run in runs})
        total = sum(self._num_sweeps(run) for run in runs)
        self._bar = progress.add_task(self._text(), total=total, completed=self._done.total())

    def watch(self, task: EvaluationTask, event: TaskEvent) -> None:
        """Takes notice of an event."""
        if isinstance(event, ResultRow):
            self._done[task.key] += 1
            # A task that was lost on the way may give a row again.
            self._times_ms[task.key][event.number] = event.time_ms
        elif isinstance(event, TaskRestarted):
            text = f"{' on '.join(task.key[::-1])}: {event.reason}, again"
            self._progress.console.print(text, markup=False, highlight=False)
        elif isinstance(event, (Findings, TaskFailed)):
            if not self._progress.console.is_terminal:
                self._say_finished(task, is_done=isinstance(event, Findings))
            # The first and the last sweep of a recording make no example.
            self._done[task.key] = self._num_sweeps(task)
            self._num_left -= 1
        self._progress.update(self._bar, completed=self._done.total(), description=self._text())

    def _num_sweeps(self, task: EvaluationTask) -> int:
        return -(-task.recording.num_sweeps // self._every)

    def _say_finished(self, task: EvaluationTask, *, is_done: bool) -> None:
        times_ms = self._times_ms[task.key]
        time_ms = mean(list(times_ms.values()))
        text = f"{' on '.join(task.key[::-1])}: {'done' if is_done else 'gave up'}"
        text += f", new examples: {len(times_ms)}"
        text += "" if math.isnan(time_ms) else f", {time_ms:.0f} ms each"
        self._progress.console.print(text, markup=False, highlight=False, soft_wrap=True)

    def _text(self) -> str:
        return f"evaluating, tasks left: {self._num_left}" if self._num_left else "evaluated"


@contextmanager
def checking_progress(console: Console, name: str) -> Iterator[Callable[[int, int], None]]:
    """Shows how far the reading of a recording is, and nothing when it is done.

    Yields:
        What to tell the number of bytes read and that of all.
    """
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


@contextmanager
def evaluation_progress(
    console: Console, runs: Sequence[EvaluationTask], every: int
) -> Iterator[EvaluationProgress]:
    """Shows a bar with the sweeps done, their rate and the time left.

    Only one of `every` sweeps counts.

    Where the output is no terminal, there is a plain line for each task as it ends.
    """
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        _SweepRateColumn(),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=console) as progress:
        yield EvaluationProgress(progress, runs, every)
