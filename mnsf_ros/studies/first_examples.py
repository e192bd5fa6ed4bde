"""Tasks that end after so many examples: a study of a long recording need not take days."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.runner import Executor, TaskEvent, TaskRun, run_serially, task_events


def first_examples(number: int | None) -> Executor:
    """Returns an Executor that runs tasks one after the other, each only to so many examples."""
    if number is None:
        return run_serially

    def execute(
        runs: Sequence[TaskRun], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        for run in runs:
            num_left = number - len(run.skipped)
            events = task_events(run, options) if num_left > 0 else iter([Findings()])
            for event in events:
                yield run.task, event
                num_left -= isinstance(event, ResultRow)
                if isinstance(event, ResultRow) and num_left == 0:
                    yield run.task, Findings()
                    break

    return execute
