"""What becomes of tasks while they run, wherever they do."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.evaluation_options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.tasks import run_task


@dataclass(frozen=True)
class TaskRun:
    """A task to be run.

    Attributes:
        task: What.
        skipped: Numbers of the sweeps whose rows are there already.
        attempt: How often it has been tried before.
    """

    task: EvaluationTask
    skipped: frozenset[int] = frozenset()
    attempt: int = 0

    def again(self, done: frozenset[int], options: EvaluationOptions) -> TaskRun:
        """Returns the next attempt, which leaves out what is done, if that can be left out."""
        has_memory = options.has_memory(self.task.method)
        skipped = frozenset() if has_memory else self.skipped | done
        return replace(self, skipped=skipped, attempt=self.attempt + 1)


@dataclass(frozen=True)
class TaskFailed:
    """A task gave up.

    Attributes:
        reason: Why, in one line.
    """

    reason: str


@dataclass(frozen=True)
class TaskRestarted:
    """A task begins anew, because the process or machine that ran it was lost.

    Attributes:
        reason: What happened, in one line.
    """

    reason: str


TaskEvent = ResultRow | Findings | TaskFailed | TaskRestarted


class Executor(Protocol):
    """Runs tasks, one after the other or side by side."""

    def __call__(
        self, runs: Sequence[TaskRun], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        """Runs all tasks and yields what they give, as it gets ready.

        The last event of each task is its Findings, or TaskFailed.
        """
        ...


def run_serially(
    runs: Sequence[TaskRun], options: EvaluationOptions
) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
    """Runs one task after the other in this process. An Executor."""
    for run in runs:
        for event in task_events(run, options):
            yield run.task, event


def task_events(run: TaskRun, options: EvaluationOptions) -> Iterator[TaskEvent]:
    """Yields the events of one task; an error of ours becomes TaskFailed."""
    try:
        yield from run_task(run.task, options, run.skipped)
    except MnsfError as error:
        yield TaskFailed(str(error))
