"""What a study is done on, and how."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.settings import Settings

Say = Callable[[str], None]


def _silent(text: str) -> None:
    """Says nothing."""


@dataclass(frozen=True)
class StudyOptions:
    """What a study is done on, and how.

    Attributes:
        out: Folder for all that the study writes.
        settings: How to estimate.
        recordings: Paths of recordings; if empty, a street is simulated.
        num_points: So many random points of each sweep; None for all.
        max_examples: At most so many examples of each recording, from its beginning; None for
            all of them. Case studies look at the first one alone.
        seed: Of the points, the start weights, the street, and whatever else is drawn.
        resume: Whether to go on with what is in the folder.
        command: The command line, to be remembered.
        say: Gets one line for each step.
    """

    out: Path
    settings: Settings
    recordings: tuple[Path, ...] = ()
    num_points: int | None = 2048
    max_examples: int | None = None
    seed: int = 0
    resume: bool = False
    command: tuple[str, ...] = ()
    say: Say = _silent

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            EvaluationError: If a number is out of its range.
        """
        if self.max_examples is not None and self.max_examples < 1:
            raise EvaluationError(f"max_examples: got {self.max_examples}, expected 1 or more")

    def evaluation(self, num_sweeps: int = 3) -> EvaluationOptions:
        """Returns the options of the evaluator.

        Raises:
            EvaluationError: If a number is out of its range.
        """
        return EvaluationOptions(
            settings=self.settings,
            num_points=self.num_points,
            seed=self.seed,
            num_sweeps=num_sweeps,
        )
