"""The paper's ablation tables: variants of the method, scored on the same examples."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mnsf_ros.drawing.study_charts import grouped_bars
from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.examples import MAX_SWEEPS
from mnsf_ros.evaluation.options import EvaluatedRecording, EvaluationTask, evaluated_methods
from mnsf_ros.evaluation.protocol import protocol_text
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import MethodSummary, summarize
from mnsf_ros.evaluation.results_files import read_results, write_results
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_start import check_folder, start_or_resume
from mnsf_ros.evaluation.runner import TaskEvent, TaskRun, plan_runs, run_evaluation
from mnsf_ros.evaluation.tables import errors_table
from mnsf_ros.studies.study import StudyOptions, StudyResult
from mnsf_ros.studies.study_examples import first_examples, study_recordings

_HEADER: Final = (
    *("variant", "method", "points", "epe_m", "acc5", "acc10", "outliers"),
    *("angle_error_rad", "num_points", "time_ms"),
)
GROUPS: Final = {"all": "all points", "dynamic": "dynamic points", "static": "static points"}


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
            "(b) inversion and mean, no fusion network": "mnsf-mean",
            "(c) without inversion": "mnsf-no-inversion",
            "(d) MNSF": "mnsf",
        },
    ),
    MethodStudy(
        "fusion",
        "Fusion operation",
        {
            "FNSF": "fnsf",
            "mean": "mnsf-mean",
            "weighted sum": "mnsf-weighted-sum",
            "MLP": "mnsf-mlp",
        },
    ),
    MethodStudy(
        "depth",
        "Depth of the fusion network",
        {f"{depth} layers": f"mnsf-depth{depth}" for depth in (2, 3, 5, 7)},
    ),
    MethodStudy(
        "frames",
        "Number of sweeps",
        {f"{number} sweeps": f"mnsf-frames{number}" for number in (2, 3, 4, 5)},
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
    evaluation = options.evaluation(study.num_sweeps)
    methods = evaluated_methods(study.variants.values(), evaluation)
    # The evaluation has a folder of its own beside the simulated street.
    recordings = study_recordings(options, study.num_sweeps)
    if not any(recording.truth for recording in recordings):
        raise RecordingError("the recordings hold no true flow, which the study compares with")
    folder = start_or_resume(
        options.out / "evaluation",
        recordings,
        methods,
        evaluation,
        resume=options.resume,
        arguments=options.command,
    )
    runs = plan_runs(recordings, methods, evaluation, folder)
    kept = _kept_notes(runs, recordings, options, folder, study)
    watch = _Watch(options, _max_rows(runs, options, study.num_sweeps))
    execute = first_examples(options.max_examples)
    run_evaluation(runs, evaluation, folder, execute=execute, watch=watch)
    results = read_results(folder)
    write_results(folder, results)
    if not any(row.errors for row in results.rows):
        why = f": {results.notes[0]}" if results.notes else ""
        raise EvaluationError(f"no example could be scored{why}")
    summaries = summarize(results.rows, list(study.variants.values()))
    texts = protocol_text(results.record, summaries)
    notes = [*map(str, results.notes), *kept]
    return study_result(study, summaries, [*texts, *(f"Note: {note}" for note in notes)])


def study_result(
    study: MethodStudy, summaries: Sequence[MethodSummary], texts: Sequence[str]
) -> StudyResult:
    """Puts the summaries of the variants into tables and a picture."""
    by_method = {summary.method: summary for summary in summaries}
    named = {name: by_method[m] for name, m in study.variants.items() if m in by_method}
    tables, rows = [], []
    for group, words in GROUPS.items():
        errors = {n: s.errors[group] for n, s in named.items() if group in s.errors}
        if not any(item.num_points for item in errors.values()):
            continue
        times_ms = {n: s.time_ms for n, s in named.items()} if group == "all" else None
        title = f"{study.title}, {words}"
        tables.append(errors_table(errors, title=title, row_title="variant", times_ms=times_ms))
        for name, item in errors.items():
            shares = (item.acc5, item.acc10, item.outliers)
            values = (item.epe_m, *shares, item.angle_error_rad, item.num_points)
            rows.append((name, study.variants[name], group, *values, named[name].time_ms))
    picture = _picture(study, named)
    return StudyResult(study.name, study.title, texts, tables, _HEADER, rows, picture)


def _max_rows(runs: Sequence[TaskRun], options: StudyOptions, num_sweeps: int) -> int:
    """How many rows there can be."""
    return sum(_max_examples(run.task.recording, options, num_sweeps) for run in runs)


def _max_examples(recording: EvaluatedRecording, options: StudyOptions, num_sweeps: int) -> int:
    """How many examples there can be: the first and the last sweeps are none."""
    number = recording.num_sweeps - num_sweeps + 1
    return min(number, options.max_examples or number)


def _kept_notes(
    runs: Sequence[TaskRun],
    recordings: Sequence[EvaluatedRecording],
    options: StudyOptions,
    folder: RunFolder,
    study: MethodStudy,
) -> list[str]:
    """Notes on recordings that were finished before, with fewer examples than are wanted now."""
    left = {run.task.key for run in runs}
    num_rows = Counter((row.recording, row.method) for row in folder.rows())
    notes = []
    for recording in recordings:
        keys = [(recording.name, method) for method in study.variants.values()]
        kept = [num_rows[key] for key in keys if key not in left]
        wanted = _max_examples(recording, options, study.num_sweeps)
        if kept and min(kept) < wanted:
            notes.append(
                f"{recording.name}: was finished before with {min(kept)} of up to {wanted} "
                "examples and is left so; another folder would start anew"
            )
    return notes


class _Watch:
    """Says how far a study is."""

    def __init__(self, options: StudyOptions, total: int) -> None:
        self._options = options
        self._total = total
        self._done = 0

    def __call__(self, task: EvaluationTask, event: TaskEvent) -> None:
        if isinstance(event, ResultRow):
            self._done += 1
            said = f"EPE {event.errors['all'].epe_m:.3f} m" if event.errors else str(event.failure)
            where = f"{task.method.name}, {event.recording} sweep {event.number}"
            self._options.say(f"{self._done} of {self._total}: {where}: {said}")


def _picture(study: MethodStudy, named: dict[str, MethodSummary]) -> bytes:
    parts = (("EPE (m), less is better", "epe_m", 1.0), ("Acc5 (%), more is better", "acc5", 100.0))
    panels = {
        title: {
            words: [
                getattr(s.errors[group], name) * factor if group in s.errors else math.nan
                for s in named.values()
            ]
            for group, words in GROUPS.items()
        }
        for title, name, factor in parts
    }
    return grouped_bars(study.title, list(named), panels)
