# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Evaluation of variants of methods, for studies."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from itertools import count
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError, RecordingError
from mnsf_ros.evaluation.options import EvaluationOptions, evaluated_methods
from mnsf_ros.evaluation.parallel import run_serially
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord, session_now
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.report.results_files import write_results
from mnsf_ros.report.run_results import RunResults, read_results
from mnsf_ros.studies.study import StudyOptions

# The default of `mnsf evaluate`.
_NUM_PICTURES: Final = 3


def evaluated(
    names: Collection[str],
    evaluation: EvaluationOptions,
    paths: Sequence[Path],
    options: StudyOptions,
) -> RunResults:
    """Evaluates methods on recordings, in the folder `evaluation` of the study.

    Raises:
        MnsfError: A recording or a setting cannot be used, or no example can be scored.
        OSError: Writing fails.
    """
    evaluation = replace(evaluation, pictures=_NUM_PICTURES)
    methods = evaluated_methods(names, evaluation)
    evaluation = evaluation.for_methods(methods, pairs=False)
    recordings = chosen_recordings(paths)
    if not any(recording.truth for recording in recordings):
        raise RecordingError("the recordings hold no true flow, which the study compares with")
    record = RunRecord(evaluation, methods, recordings, [session_now(options.command)])
    folder = RunFolder(options.out / "evaluation")
    tasks, numbers = folder.begin(record, resume=options.resume), count(1)
    for _, event in run_serially(tasks, evaluation):
        folder.take(event)
        if isinstance(event, ResultRow):
            options.say(f"{next(numbers)}: {_line_of(event)}")
    results = read_results(folder)
    write_results(folder, results)
    if not any(row.errors for row in results.table["row"]):
        why = f": {results.notes[0].text}" if results.notes else ""
        raise EvaluationError(f"no example could be scored{why}")
    return results


def texts_on(results: RunResults) -> list[str]:
    """Returns paragraphs on the data and options of the figures, and on their limits."""
    return [*results.protocol, *(f"Note: {note.text}" for note in results.notes)]


def _line_of(row: ResultRow) -> str:
    result = f"EPE {row.errors['all'].epe_m:.3f} m" if row.errors else row.failure
    return f"{row.method}, {row.recording} sweep {row.number}: {result}"
