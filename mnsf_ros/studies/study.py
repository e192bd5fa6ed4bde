# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Studies by name; each writes a page in Markdown and numbers as CSV."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from importlib import import_module
from pathlib import Path
from typing import Final

import pandas as pd

from mnsf_ros.errors import RecordingError, SettingsError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.evaluation.run_folder import check_folder
from mnsf_ros.evaluation.run_record import session_now
from mnsf_ros.evaluation.tracks import Findings
from mnsf_ros.report.results_files import session_lines
from mnsf_ros.report.text_table import TextTable, markdown_text
from mnsf_ros.setting import check_declared, declared

# Name to module, which is imported for this study alone because it needs PyTorch, and summary. The
# module has `run`, which gets the name and the options and returns a StudyResult.
STUDIES: Final = {
    "ablation": ("method_study", "FNSF, and MNSF without single parts: (a) to (d) of the paper"),
    "fusion": ("method_study", "fusion by mean, by weighted sum and by a network"),
    "depth": ("method_study", "fusion network with 2, 3, 5 and 7 layers"),
    "frames": ("method_study", "2, 3, 4 and 5 sweeps"),
    "landscape": ("landscape_study", "loss around the optimum, FNSF and MNSF"),
    "stability": (
        "stability_study",
        "effect of replacing one point of N, expected to fall with 1/N",
    ),
    "warm-start": ("warm_study", "errors over the sweeps since the start, warm and from scratch"),
}


@dataclass(frozen=True)
class CaseStudySettings:
    """Settings of the case studies, each an option of the command.

    Raises:
        SettingsError: If a value is out of its range.
    """

    directions: int = declared(10, "landscape: random directions, for its sharpness", 2, 10_000)
    sizes: str = declared(
        "128,256,512,1024,2048", "stability: numbers of points, three or more in ascending order"
    )
    repeats: int = declared(5, "stability: random draws for each number of points", 1, 10_000)
    methods: str = declared("nsfp,fnsf,mnsf", "stability: methods to compare")
    warm_steps: str = declared(
        "2,5,10", "warm-start: steps per sweep of networks that go on, in ascending order"
    )
    cold_steps: str = declared(
        "10,40", "warm-start: steps of networks from scratch, in ascending order"
    )

    def __post_init__(self) -> None:
        check_declared(self)
        for name, count, least in (("sizes", 3, 2), ("warm_steps", 1, 1), ("cold_steps", 1, 1)):
            text = getattr(self, name)
            numbers = _numbers(text)
            if len(numbers) < count or min(numbers) < least or numbers != sorted(set(numbers)):
                raise SettingsError(
                    f"{name}: got {text}, expected {count} or more numbers from {least} in "
                    "ascending order"
                )

    @property
    def numbers_of_points(self) -> list[int]:
        """The `sizes`."""
        return _numbers(self.sizes)

    @property
    def numbers_of_warm_steps(self) -> list[int]:
        """The `warm_steps`."""
        return _numbers(self.warm_steps)

    @property
    def numbers_of_cold_steps(self) -> list[int]:
        """The `cold_steps`."""
        return _numbers(self.cold_steps)

    @property
    def method_names(self) -> list[str]:
        """The `methods`, each once."""
        return list(dict.fromkeys(self.methods.split(",")))


def _numbers(text: str) -> list[int]:
    """Whole numbers with commas between them; 0 stands for what is none."""
    return [int(part) if part.isdecimal() else 0 for part in text.split(",")]


@dataclass(frozen=True)
class StudyOptions:
    """Data and settings of a study.

    Attributes:
        out: Folder for all files of the study.
        evaluation: How to estimate, and which examples; `landscape` and `stability` use the first
            one alone. Its seed is also that of all other draws.
        recordings: Paths of recordings.
        resume: Whether to continue with the files in the folder.
        command: The command line, for the record.
        say: Gets one line for each step.
        case: Settings of the case studies.
    """

    out: Path
    evaluation: EvaluationOptions
    recordings: Sequence[Path]
    resume: bool = False
    command: tuple[str, ...] = ()
    say: Callable[[str], None] = lambda text: None
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
    picture: bytes = b""  # a PNG file; empty if tables say it all


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
