# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file with all of its pictures, without network or scripts."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from pathlib import Path
from typing import Final, NamedTuple

import jinja2

from mnsf_ros import __version__
from mnsf_ros.evaluation.pictures import ANIMATION, picture_file, worst_name
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import missed_table, worst_table
from mnsf_ros.report.text_table import format_number
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
    """Writes the report, with the pictures that the run has drawn.

    An earlier one is replaced as a whole or not at all.

    Returns:
        The file.

    Raises:
        StoppedError: Writing fails.
    """
    tables = (
        worst_table(results.worst, results.focus),
        missed_table(results.table["row"], results.focus),
    )
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        results=results,
        animation=_animation(results, folder.path),
        worst_tables=[table for table in tables if table.rows],
        pictures=list(_worst(results, folder.path)),
    )
    path = folder.path / REPORT_FILE
    replace_file(path, [f"{page}\n"])
    return path


class Image(NamedTuple):
    """An image of the page: a data URI, a text for those who do not see it, a caption."""

    uri: str
    alt: str
    caption: str


def _animation(results: RunResults, folder: Path) -> Image | None:
    """The first sweeps of a recording by one method, of the first that has an animation."""
    for recording in results.record.recordings:
        caption = f"{recording.name}, the first scored sweeps. {_places(recording, results.focus)}"
        where = (recording.name, results.focus, ANIMATION)
        if image := _image(folder, *where, f"Animation of what moves in {caption}", caption):
            return image
    return None


def _worst(results: RunResults, folder: Path) -> Iterator[Image]:
    recordings = {one.name: one for one in results.record.recordings}
    for row in results.worst["row"]:
        where = f"{row.recording}, sweep {row.number}, {row.stamp_ns / NANOSECONDS:.3f} s"
        places = _places(recordings[row.recording], row.method)
        caption = f"{where}: {_figure(row)}. {places}"
        name = worst_name(row.number)
        alt = f"What moves in {caption}"
        if image := _image(folder, row.recording, row.method, name, alt, caption):
            yield image


def _image(
    folder: Path, recording: str, method: str, name: str, alt: str, caption: str
) -> Image | None:
    """The image of a picture that is there."""
    file = picture_file(folder, recording, method, name)
    if not file.is_file():
        return None
    content = base64.b64encode(file.read_bytes()).decode("ascii")
    return Image(f"data:image/{file.suffix[1:]};base64,{content}", alt, caption)


def _places(recording: EvaluatedRecording, method: str) -> str:
    return f"Left: truth. Right: {method}." if recording.truth else f"{method}."


def _figure(row: ResultRow) -> str:
    if "all" in row.errors and row.errors["all"].num_points:
        return f"EPE {row.badness_m:.3f} m"
    return f"{format_number(row.badness_m, 3)} m from the moved points to the next sweep"
