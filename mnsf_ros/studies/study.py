# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Studies by name; each writes a page in Markdown and numbers as CSV."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path

import pandas as pd

from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.evaluation.run_folder import check_folder
from mnsf_ros.evaluation.run_record import session_now
from mnsf_ros.report.results_files import session_lines
from mnsf_ros.report.text_table import TextTable, markdown_text
from mnsf_ros.studies.settings import STUDIES, CaseStudySettings


@dataclass(frozen=True)
class StudyOptions:
    """Data and settings of a study; `landscape` and `stability` use the first example only."""

    out: Path  # folder for all files
    evaluation: EvaluationOptions  # its seed is used for all other draws, too
    recordings: Sequence[Path]
    resume: bool = False  # whether to continue with the files in the folder
    command: tuple[str, ...] = ()  # for the record
    say: Callable[[str], None] = lambda text: None  # gets one line for each step
    case: CaseStudySettings = field(default_factory=CaseStudySettings)

    def first_example(self) -> Example:
        """Returns the first example.

        Raises:
            MnsfError: A recording cannot be used, or there is no example.
        """
        for recording in chosen_recordings(self.recordings):
            for example in read_examples(recording, self.evaluation, Findings()):
                return example
        raise RecordingError("the recordings hold no three sweeps in a row")


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
        "recordings": ", ".join(map(str, options.recordings)),
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
