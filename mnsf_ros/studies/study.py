"""What a study is done on, and what it writes: a page in Markdown, numbers as CSV, a chart."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.run_record import SessionRecord
from mnsf_ros.evaluation.tables import TextTable
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


@dataclass(frozen=True)
class StudyResult:
    """What came out of a study.

    Attributes:
        name: Name of the study.
        title: Headline of its page.
        texts: Paragraphs on what was measured, and how.
        tables: Tables for people.
        header: Titles of the columns of the CSV file.
        rows: Its rows; the same study gives the same ones, times apart.
        picture: The chart, a PNG file.
    """

    name: str
    title: str
    texts: Sequence[str]
    tables: Sequence[TextTable]
    header: Sequence[str]
    rows: Sequence[Sequence[object]]
    picture: bytes


def write_study(result: StudyResult, options: StudyOptions) -> list[Path]:
    """Writes NAME.md, NAME.csv and NAME.png into the folder of the study.

    Raises:
        OSError: Writing fails.
    """
    options.out.mkdir(parents=True, exist_ok=True)
    paths = [options.out / f"{result.name}{suffix}" for suffix in (".md", ".csv", ".png")]
    paths[0].write_text(_page(result, options), encoding="utf-8")
    paths[1].write_text(_csv(result), encoding="utf-8")
    paths[2].write_bytes(result.picture)
    return paths


def _page(result: StudyResult, options: StudyOptions) -> str:
    parts = [f"# {result.title}", *result.texts]
    parts += [table.markdown().rstrip("\n") for table in result.tables]
    parts += [f"![{result.title}]({result.name}.png)", "## Run"]
    session = SessionRecord.now(options.command)
    facts = {
        "command": f"`{' '.join(session.command)}`" if session.command else "",
        "seed": str(options.seed),
        "points of a sweep": "all" if options.num_points is None else f"{options.num_points:,}",
        "recordings": ", ".join(map(str, options.recordings)) or "a simulated street",
        "machine": str(session.machine),
        "versions": ", ".join(f"{name} {value}" for name, value in session.versions.items()),
        "git commit": session.git_commit or "none, not a checkout",
    }
    parts.append("\n".join(f"* {name}: {text}" for name, text in facts.items() if text))
    settings = options.settings.to_mapping()
    lines = [f"| {name} | {value} |" for name, value in settings.items()]
    parts.append("\n".join(["| setting | value |", "| :--- | ---: |", *lines]))
    return "\n\n".join(parts) + "\n"


def _csv(result: StudyResult) -> str:
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(result.header)
    writer.writerows(result.rows)
    return text.getvalue()
