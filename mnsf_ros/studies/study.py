# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Studies by name; each writes a page in Markdown and numbers as CSV."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field, replace
from importlib import import_module
from itertools import count
from pathlib import Path
from typing import Final

import pandas as pd

from mnsf_ros.errors import EvaluationError, RecordingError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, evaluated_methods
from mnsf_ros.evaluation.parallel import run_serially
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_folder import RunFolder, check_folder
from mnsf_ros.evaluation.run_record import RunRecord, session_now
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.report.results_files import session_lines, write_results
from mnsf_ros.report.run_results import RunResults, read_results
from mnsf_ros.report.text_table import TextTable, markdown_text
from mnsf_ros.studies.settings import STUDIES, CaseStudySettings

# The default of `mnsf evaluate`.
_NUM_PICTURES: Final = 3


@dataclass(frozen=True)
class StudyOptions:
    """Data and settings of a study; `landscape` and `stability` use the first example only."""

    out: Path  # folder for all files
    evaluation: EvaluationOptions  # its seed is used for all other draws, too
    recordings: Sequence[EvaluatedRecording]  # they get what of them is damaged
    resume: bool = False  # whether to continue with the files in the folder
    command: tuple[str, ...] = ()  # for the record
    say: Callable[[str], None] = lambda text: None  # gets one line for each step
    case: CaseStudySettings = field(default_factory=CaseStudySettings)

    def first_example(self) -> Example:
        """Returns the first example.

        Raises:
            MnsfError: A recording cannot be used, or there is no example.
        """
        for recording in self.recordings:
            for example in read_examples(recording, self.evaluation, Findings()):
                return example
        raise RecordingError("the recordings hold no three sweeps in a row")

    def evaluated(
        self,
        names: Collection[str],
        evaluation: EvaluationOptions,
        recordings: Sequence[EvaluatedRecording],
    ) -> RunResults:
        """Evaluates methods on recordings, in the folder `evaluation` of the study.

        Raises:
            MnsfError: A recording or a setting cannot be used, or no example can be scored.
            OSError: Writing fails.
        """
        evaluation = replace(evaluation, pictures=_NUM_PICTURES)
        methods = evaluated_methods(names, evaluation)
        evaluation = evaluation.for_methods(methods, pairs=False)
        if not any(recording.truth for recording in recordings):
            raise RecordingError("the recordings hold no true flow, which the study compares with")
        record = RunRecord(evaluation, methods, [*recordings], [session_now(self.command)])
        folder = RunFolder(self.out / "evaluation")
        tasks, numbers = folder.begin(record, resume=self.resume), count(1)
        for _, event in run_serially(tasks, evaluation):
            folder.take(event)
            if isinstance(event, ResultRow):
                self.say(f"{next(numbers)}: {_line_of(event)}")
        results = read_results(folder)
        write_results(folder, results)
        if not any(row.errors for row in results.table["row"]):
            why = f": {results.notes[0].text}" if results.notes else ""
            raise EvaluationError(f"no example could be scored{why}")
        return results


def _line_of(row: ResultRow) -> str:
    result = f"EPE {row.errors['all'].epe_m:.3f} m" if row.errors else row.failure
    return f"{row.method}, {row.recording} sweep {row.number}: {result}"


def texts_on(results: RunResults) -> list[str]:
    """Returns paragraphs on the data and options of the figures, and on their limits."""
    return [*results.protocol, *(f"Note: {note.text}" for note in results.notes)]


@dataclass(frozen=True)
class StudyResult:
    """Result of a study."""

    title: str
    texts: Sequence[str]  # paragraphs on the measurement
    tables: Sequence[TextTable]
    numbers: pd.DataFrame  # the CSV file; the same study gives the same one, times apart
    evaluation: EvaluationOptions  # behind the figures
    picture: bytes = b""  # a PNG file, if any


def run_study(name: str, options: StudyOptions) -> tuple[StudyResult, list[Path]]:
    """Runs one of `STUDIES`; returns its result and its files, NAME.md first.

    Raises:
        MnsfError: An option, a setting, a recording or the folder cannot be used, or a fit fails.
        OSError: Writing fails.
    """
    module = import_module(f"mnsf_ros.studies.{STUDIES[name][0]}")
    check_folder(options.out, resume=options.resume)
    result: StudyResult = module.run(name, options)
    options.out.mkdir(parents=True, exist_ok=True)
    suffixes = (".md", ".csv", *([".png"] if result.picture else []))
    paths = [options.out / f"{name}{suffix}" for suffix in suffixes]
    paths[0].write_text(_page(name, result, options), encoding="utf-8")
    result.numbers.to_csv(paths[1], index=False, na_rep="nan", lineterminator="\n")
    if result.picture:
        paths[2].write_bytes(result.picture)
    return result, paths


def _page(name: str, result: StudyResult, options: StudyOptions) -> str:
    facts = {
        "seed": str(result.evaluation.seed),
        "points of a sweep": str(result.evaluation.num_points or "all"),
        "recordings": ", ".join(one.path for one in options.recordings),
    }
    settings = result.evaluation.settings.to_mapping().items()
    lines = [f"| {setting} | {value} |" for setting, value in settings]
    parts = [
        f"# {result.title}",
        *map(markdown_text, result.texts),
        *(table.markdown().rstrip("\n") for table in result.tables),
        *([f"![{result.title}]({name}.png)"] if result.picture else []),
        "## Run",
        "\n".join(session_lines(session_now(options.command) | facts)),
        "\n".join(["| setting | value |", "| :--- | ---: |", *lines]),
    ]
    return "\n\n".join(parts) + "\n"
