# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Options, recordings and result of a study."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import pandas as pd

from mnsf_ros.errors import EvaluationError, RecordingError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording, choose_topics, named_recordings
from mnsf_ros.report.text_table import TextTable
from mnsf_ros.settings import Settings
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings

# A lidar of medium density: a few thousand points without ground, as the paper's smaller table.
_BEAMS, _COLUMNS = 32, 1024
# Of a simulated street, by default.
_SIMULATED_EXAMPLES: Final = 4
# In lengths of the weight vector; far beyond, losses are not finite.
_MAX_RADIUS: Final = 10.0


@dataclass(frozen=True)
class StudyOptions:
    """Data and settings of a study.

    Attributes:
        out: Folder for all files of the study.
        settings: How to estimate.
        recordings: Paths of recordings; if empty, a street is simulated.
        num_points: Number of random points of each sweep; None for all.
        max_examples: Maximum number of examples of each recording, from its beginning; None for
            all. Case studies use the first one alone.
        seed: Of the points, the start weights, the street, and all other draws.
        resume: Whether to continue with the files in the folder.
        command: The command line, for the record.
        say: Gets one line for each step.
        radius: Half width of the picture of a landscape, in lengths of the weight vector.
        num_steps: Steps from one side of a landscape to the other, an odd number.
        num_directions: Random directions in which the sharpness of a landscape is measured.
        sizes: Numbers of points at which stability is measured, ascending; three or more, for a
            slope with its standard error.
        num_repeats: Draws of points for each of them.
        methods: Methods whose stability is measured.

    Raises:
        EvaluationError: If a number is out of its range.
    """

    out: Path
    settings: Settings
    recordings: tuple[Path, ...] = ()
    num_points: int | None = 2048
    max_examples: int | None = None
    seed: int = 0
    resume: bool = False
    command: tuple[str, ...] = ()
    say: Callable[[str], None] = lambda text: None
    radius: float = 0.5
    num_steps: int = 21
    num_directions: int = 10
    sizes: tuple[int, ...] = (128, 256, 512, 1024, 2048)
    num_repeats: int = 5
    methods: tuple[str, ...] = ("nsfp", "fnsf", "mnsf")

    def __post_init__(self) -> None:
        sizes, methods = (", ".join(map(str, values)) for values in (self.sizes, self.methods))
        has_slope = len(self.sizes) >= 3 and list(self.sizes) == sorted(set(self.sizes))
        for name, value, is_good, expected in (
            ("radius", f"{self.radius:g}", 0 < self.radius <= _MAX_RADIUS, "above 0, at most 10"),
            ("steps", self.num_steps, self.num_steps in range(3, 10_000, 2), "an odd number"),
            ("directions", self.num_directions, self.num_directions >= 2, "2 or more"),
            ("sizes", sizes, has_slope, "3 or more numbers in ascending order"),
            ("sizes", sizes, min(self.sizes, default=0) >= 2, "2 points or more each"),
            ("repeats", self.num_repeats, self.num_repeats >= 1, "1 or more"),
            ("methods", methods, len(set(self.methods)) == len(self.methods), "each once"),
        ):
            if not is_good:
                raise EvaluationError(f"{name}: got {value}, expected {expected}")
        self.evaluation()

    def evaluation(self, num_sweeps: int = 3) -> EvaluationOptions:
        """Returns the options of the evaluator.

        Raises:
            EvaluationError: If a number is out of its range.
        """
        return EvaluationOptions(
            self.settings,
            num_points=self.num_points,
            seed=self.seed,
            num_sweeps=num_sweeps,
            max_examples=self.max_examples,
        )


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
        total = (options.max_examples or _SIMULATED_EXAMPLES) + num_sweeps - 1
        settings = SimulationSettings(options.seed, num_beams=_BEAMS, num_columns=_COLUMNS)
        write_recording(replace(settings, duration_s=total / settings.rate_hz), path)
    return path


def first_example(options: StudyOptions) -> Example:
    """Returns the first example of a study.

    Raises:
        RecordingError: There is none.
    """
    for recording in study_recordings(options):
        with recording.open() as reader:
            for example in read_examples(reader, recording, options.evaluation(), Findings()):
                return example
    raise RecordingError("the recordings hold no three sweeps in a row")
