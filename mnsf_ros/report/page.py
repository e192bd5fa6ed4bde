# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file with all of its pictures, without network or scripts."""

import base64
from collections.abc import Iterable, Iterator
from functools import partial
from itertools import cycle
from pathlib import Path
from typing import Final, NamedTuple

import jinja2

from mnsf_ros import __version__
from mnsf_ros.drawing.color_wheel import FULL_ERROR_M
from mnsf_ros.drawing.street_picture import ABOVE_M
from mnsf_ros.evaluation.pictures import ANIMATION, picture_file, worst_name
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.report.plots import COLORS, plots_of
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import best_cells, missed_tables
from mnsf_ros.sweeps.sweep import NANOSECONDS

REPORT_FILE: Final = "report.html"
_TEMPLATES: Final = jinja2.Environment(
    loader=jinja2.PackageLoader("mnsf_ros.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_report(folder: RunFolder, results: RunResults) -> Path:
    """Writes the report, with the pictures that the run has drawn, and returns its file.

    Raises:
        StoppedError: Writing fails; an earlier report is still there.
    """
    recordings = {one.name: one for one in results.record.recordings}
    first = (
        (one, ANIMATION, f"{name}, the first scored sweeps") for name, one in recordings.items()
    )
    worst = (
        (recordings[row.recording], worst_name(row.number), _worst_text(row))
        for row in results.worst["row"]
    )
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        results=results,
        animation=next(_images(folder.path, results.focus, first), None),
        plots=list(plots_of(results.summary)),
        colors=dict(zip(results.summary.index, cycle(COLORS), strict=False)),
        missed=missed_tables(results.table["row"], results.focus),
        best_of=partial(best_cells, references=results.record.references),
        pictures=list(_images(folder.path, results.focus, worst)),
    )
    path = folder.path / REPORT_FILE
    replace_file(path, f"{page}\n")
    return path


class Image(NamedTuple):
    """An image of the page: a data URI, and a caption."""

    uri: str
    caption: str


def _images(
    folder: Path, method: str, wanted: Iterable[tuple[EvaluatedRecording, str, str]]
) -> Iterator[Image]:
    """Yields the images that exist, of recordings, names and beginnings of captions."""
    for recording, name, text in wanted:
        file = folder / picture_file(recording.name, method, name)
        if file.is_file():
            content = base64.b64encode(file.read_bytes()).decode("ascii")
            yield Image(
                f"data:image/{file.suffix[1:]};base64,{content}",
                f"{text}. {_places(recording, method, name)}",
            )


def _places(recording: EvaluatedRecording, method: str, name: str) -> str:
    """Returns the end of a caption: the contents of a picture from left to right."""
    if not recording.truth:
        return f"{method}."
    if name == ANIMATION:
        return f"Left: truth. Right: {method}."
    return (
        f"Left: truth. Middle: {method}. Right: errors from above, to {ABOVE_M:g} m, red from "
        f"{FULL_ERROR_M:g} m."
    )


def _worst_text(row: ResultRow) -> str:
    where = f"{row.recording}, sweep {row.number}, {row.stamp_ns / NANOSECONDS:.3f} s"
    if "all" in row.errors and row.errors["all"].num_points:
        return f"{where}: EPE {row.badness_m:.3f} m"
    return f"{where}: {row.badness_m:.3f} m from the moved points to the next sweep"
