"""What every study writes: a page in Markdown, its numbers as CSV, and a picture."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from mnsf_ros.evaluation.run_record import SessionRecord
from mnsf_ros.evaluation.tables import TextTable
from mnsf_ros.studies.study_options import StudyOptions

_DPI: Final = 120


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
        figure: The picture.
    """

    name: str
    title: str
    texts: Sequence[str]
    tables: Sequence[TextTable]
    header: Sequence[str]
    rows: Sequence[Sequence[object]]
    figure: Figure


def new_figure(width: float, height: float) -> Figure:
    """Returns a figure of so many inches that knows nothing of any display."""
    figure = Figure((width, height), dpi=_DPI, layout="constrained")
    FigureCanvasAgg(figure)
    return figure


def write_study(result: StudyResult, options: StudyOptions) -> list[Path]:
    """Writes NAME.md, NAME.csv and NAME.png into the folder of the study.

    Raises:
        OSError: Writing fails.
    """
    options.out.mkdir(parents=True, exist_ok=True)
    paths = [options.out / f"{result.name}{suffix}" for suffix in (".md", ".csv", ".png")]
    paths[0].write_text(_page(result, options), encoding="utf-8")
    paths[1].write_text(_csv(result), encoding="utf-8")
    result.figure.savefig(paths[2], dpi=_DPI, metadata={"Software": None})
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
