# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's ablation tables: variants of the method, scored on the same examples."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, fields, replace
from itertools import count
from typing import Final

import pandas as pd

from mnsf_ros.drawing.study_charts import grouped_bars
from mnsf_ros.errors import EvaluationError, RecordingError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.options import (
    MAX_SWEEPS,
    EvaluationOptions,
    EvaluationTask,
    TaskKey,
    evaluated_methods,
)
from mnsf_ros.evaluation.parallel import Executor, run_serially
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder, check_folder
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.summary import errors_in
from mnsf_ros.evaluation.task import TaskEvent, task_events
from mnsf_ros.report.results_files import write_results
from mnsf_ros.report.run_results import read_results
from mnsf_ros.report.run_tables import tables_of
from mnsf_ros.report.tables import errors_table
from mnsf_ros.studies.study import StudyOptions, StudyResult, study_recordings

_ERRORS: Final = tuple(field.name for field in fields(FlowErrors))
_HEADER: Final = ("variant", "method", "points", *_ERRORS, "time_ms")
# As `mnsf evaluate` has it.
_NUM_PICTURED: Final = 3
_GROUPS: Final = {"all": "all points", "dynamic": "dynamic points", "static": "static points"}
_FIGURES: Final = (
    ("EPE (m), less is better", "epe_m", 1.0),
    ("Acc5 (%), more is better", "acc5", 100.0),
)


@dataclass(frozen=True)
class MethodStudy:
    """A table of the paper.

    Attributes:
        name: Name of the study.
        title: What is compared.
        variants: What a row is called, to the method of it.
        num_sweeps: Sweeps that the variant with the largest appetite needs.
    """

    name: str
    title: str
    variants: dict[str, str]
    num_sweeps: int = 3


METHOD_STUDIES: Final = (
    MethodStudy(
        "ablation",
        "Ablation: what each part of the method is worth",
        {
            "FNSF": "fnsf",
            "(a) without the backward flow": "mnsf-no-backward",
            "(b) inversion and mean, no fusion network": "mnsf+fusion.kind=mean",
            "(c) without inversion": "mnsf+fusion.inversion=false",
            "(d) MNSF": "mnsf",
        },
    ),
    MethodStudy(
        "fusion",
        "Fusion operation",
        {
            "FNSF": "fnsf",
            "mean": "mnsf+fusion.kind=mean",
            "weighted sum": "mnsf+fusion.kind=weighted_sum",
            "MLP": "mnsf+fusion.kind=mlp",
        },
    ),
    MethodStudy(
        "depth",
        "Depth of the fusion network",
        {f"{depth} layers": f"mnsf+fusion.num_hidden_layers={depth}" for depth in (2, 3, 5, 7)},
    ),
    MethodStudy(
        "frames",
        "Number of sweeps",
        {
            "2 sweeps": "mnsf-no-backward",
            "3 sweeps": "mnsf",
            "4 sweeps": "mnsf-frames4",
            "5 sweeps": "mnsf-frames5",
        },
        num_sweeps=MAX_SWEEPS,
    ),
)


def run_method_study(study: MethodStudy, options: StudyOptions) -> StudyResult:
    """Evaluates the variants; `evaluation` in the folder is an evaluation like any other.

    Raises:
        MnsfError: A recording, a setting or the folder cannot be used.
        OSError: Writing fails.
    """
    check_folder(options.out, resume=options.resume)
    evaluation = replace(options.evaluation(study.num_sweeps), num_pictured=_NUM_PICTURED)
    methods = evaluated_methods(study.variants.values(), evaluation)
    # The evaluation has a folder of its own beside the simulated street.
    recordings = study_recordings(options, study.num_sweeps)
    if not any(recording.truth for recording in recordings):
        raise RecordingError("the recordings hold no true flow, which the study compares with")
    max_examples = {
        recording.name: _max_examples(recording, options, study) for recording in recordings
    }
    record = RunRecord(evaluation, methods, recordings, [SessionRecord.now(options.command)])
    with RunFolder(options.out / "evaluation").opened(resume=options.resume) as folder:
        tasks = folder.begin(record)
        kept = list(_kept_notes(study, {task.key for task in tasks}, max_examples, folder))
        total, numbers = sum(max_examples[task.recording.name] for task in tasks), count(1)
        for task, event in _first_examples(options.max_examples)(tasks, evaluation):
            folder.take(task, event)
            if isinstance(event, ResultRow):
                options.say(f"{next(numbers)} of {total}: {_said(event)}")
        results = read_results(folder)
        write_results(folder, results, tables_of(results))
    if not any(row.errors for row in results.table["row"]):
        why = f": {results.notes[0].text}" if results.notes else ""
        raise EvaluationError(f"no example could be scored{why}")
    notes = [f"Note: {text}" for text in (*(note.text for note in results.notes), *kept)]
    return _result(study, results.summary, [*results.protocol, *notes])


def _said(row: ResultRow) -> str:
    said = f"EPE {row.errors['all'].epe_m:.3f} m" if row.errors else str(row.failure)
    return f"{row.method}, {row.recording} sweep {row.number}: {said}"


def _max_examples(recording: EvaluatedRecording, options: StudyOptions, study: MethodStudy) -> int:
    """How many examples there can be: the first and the last sweeps are none."""
    number = recording.num_sweeps - study.num_sweeps + 1
    return min(number, options.max_examples or number)


def _kept_notes(
    study: MethodStudy, left: set[TaskKey], max_examples: dict[str, int], folder: RunFolder
) -> Iterator[str]:
    """Notes on recordings that were finished before, with fewer examples than are wanted now."""
    numbers = folder.numbers()
    for name, wanted in max_examples.items():
        keys = [(name, method) for method in study.variants.values()]
        kept = [len(numbers.get(key, ())) for key in keys if key not in left]
        if kept and min(kept) < wanted:
            yield (
                f"{name}: was finished before with {min(kept)} of up to {wanted} examples and is "
                "left so; another folder would start anew"
            )


def _first_examples(number: int | None) -> Executor:
    """An Executor that runs tasks one after the other, each only to so many examples."""
    if number is None:
        return run_serially

    def execute(
        tasks: Sequence[EvaluationTask], options: EvaluationOptions
    ) -> Iterator[tuple[EvaluationTask, TaskEvent]]:
        for task in tasks:
            num_left = number - len(task.skipped)
            events = task_events(task, options) if num_left > 0 else iter([Findings()])
            for event in events:
                yield task, event
                num_left -= isinstance(event, ResultRow)
                if isinstance(event, ResultRow) and num_left == 0:
                    yield task, Findings()
                    break

    return execute


def _result(study: MethodStudy, summary: pd.DataFrame, texts: Sequence[str]) -> StudyResult:
    """The summary of the variants as tables and a picture."""
    known = {name: m for name, m in study.variants.items() if m in summary.index}
    named = summary.loc[list(known.values())].set_axis(list(known))
    tables, rows = [], []
    errors = {group: errors_in(named, group).reindex(columns=_ERRORS) for group in _GROUPS}
    for group, words in _GROUPS.items():
        if not errors[group]["num_points"].any():
            continue
        times = named[["time_ms"] if group == "all" else []]
        title = f"{study.title}, {words}"
        tables.append(errors_table(errors[group].join(times), title, "variant"))
        rows += [
            (name, known[name], group, *item[:-1], int(item.num_points), named.at[name, "time_ms"])
            for name, item in errors[group].iterrows()
        ]
    panels = {
        title: {
            words: (errors[group][figure].reindex(named.index) * factor).tolist()
            for group, words in _GROUPS.items()
        }
        for title, figure, factor in _FIGURES
    }
    picture = grouped_bars(study.title, list(named.index), panels)
    return StudyResult(study.name, study.title, texts, tables, _HEADER, rows, picture)
