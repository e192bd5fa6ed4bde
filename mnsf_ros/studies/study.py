# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Options, recordings and result of a study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Final

import pandas as pd

from mnsf_ros.errors import RecordingError, SettingsError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording, choose_topics, named_recordings
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.setting import check_declared, declared
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

# A lidar of medium density: a few thousand points without ground, as the paper's smaller table.
_BEAMS, _COLUMNS = 32, 1024
# Of a simulated street, by default.
_SIMULATED_EXAMPLES: Final = 4


@dataclass(frozen=True)
class CaseStudySettings:
    """Settings of the case studies, each an option of the command.

    Raises:
        SettingsError: If a value is out of its range.
    """

    radius: float = declared(
        0.5, "landscape: half width of the picture, in lengths of the weight vector", 0.001, 10
    )
    steps: int = declared(21, "landscape: grid points along each side, an odd number", 3, 9_999)
    directions: int = declared(10, "landscape: random directions, for its sharpness", 2, 10_000)
    sizes: str = declared(
        "128,256,512,1024,2048", "stability: numbers of points, three or more in ascending order"
    )
    repeats: int = declared(5, "stability: random draws for each number of points", 1, 10_000)
    methods: str = declared("nsfp,fnsf,mnsf", "stability: methods to compare")

    def __post_init__(self) -> None:
        check_declared(self)
        if self.steps % 2 == 0:
            raise SettingsError(f"steps: got {self.steps}, expected an odd number")
        numbers = self.numbers_of_points
        if len(numbers) < 3 or min(numbers) < 2 or numbers != sorted(set(numbers)):
            raise SettingsError(
                f"sizes: got {self.sizes}, expected 3 or more numbers from 2 in ascending order"
            )
        methods = self.methods.split(",")
        if len(set(methods)) < len(methods):
            raise SettingsError(f"methods: got {self.methods}, expected each once")

    @property
    def numbers_of_points(self) -> list[int]:
        """The `sizes`."""
        return [int(text) if text.isdecimal() else 0 for text in self.sizes.split(",")]


@dataclass(frozen=True)
class StudyOptions:
    """Data and settings of a study.

    Attributes:
        out: Folder for all files of the study.
        evaluation: How to estimate, and which examples; case studies use the first one alone. Its
            seed is also that of the street and all other draws.
        recordings: Paths of recordings; if empty, a street is simulated.
        resume: Whether to continue with the files in the folder.
        command: The command line, for the record.
        say: Gets one line for each step.
        case: Settings of the case studies.
    """

    out: Path
    evaluation: EvaluationOptions
    recordings: tuple[Path, ...] = ()
    resume: bool = False
    command: tuple[str, ...] = ()
    say: Callable[[str], None] = lambda text: None
    case: CaseStudySettings = field(default_factory=CaseStudySettings)


@dataclass(frozen=True)
class StudyResult:
    """Result of a study.

    Attributes:
        title: Headline of its page.
        texts: Paragraphs on the measurement.
        tables: Tables for people.
        numbers: The CSV file; the same study gives the same one, times apart.
        picture: The chart, a PNG file.
    """

    title: str
    texts: Sequence[str]
    tables: Sequence[TextTable]
    numbers: pd.DataFrame
    picture: bytes


def study_recordings(options: StudyOptions, num_sweeps: int = 3) -> list[EvaluatedRecording]:
    """Returns the recordings of a study; without any, writes a simulated one into its folder.

    Raises:
        RecordingError: A recording cannot be used, has fewer than `num_sweeps` sweeps, or the
            simulated one cannot be written.
    """
    paths = options.recordings or (_simulated_street(options, num_sweeps),)
    recordings = [choose_topics(path, name) for name, path in named_recordings(paths)]
    for path, recording in zip(paths, recordings, strict=True):
        if recording.num_sweeps < num_sweeps:
            raise RecordingError(
                f"{path}: has {recording.num_sweeps} sweeps, the study needs {num_sweeps}"
            )
    return recordings


def _simulated_street(options: StudyOptions, num_sweeps: int) -> Path:
    path = options.out / "street"
    if not path.exists():
        options.say("simulating a street")
        # An example lies between the sweeps before it and the one after.
        evaluation = options.evaluation
        total = (evaluation.max_examples or _SIMULATED_EXAMPLES) + num_sweeps - 1
        settings = SimulationSettings(
            options.evaluation.seed, num_beams=_BEAMS, num_columns=_COLUMNS
        )
        write_recording(replace(settings, duration_s=total / settings.rate_hz), path)
    return path


def first_example(options: StudyOptions) -> Example:
    """Returns the first example of a study.

    Raises:
        RecordingError: There is none.
    """
    for recording in study_recordings(options):
        with recording.open() as reader:
            for example in read_examples(reader, recording, options.evaluation, Findings()):
                return example
    raise RecordingError("the recordings hold no three sweeps in a row")
