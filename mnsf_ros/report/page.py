# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file with all of its pictures, without network or scripts."""

from __future__ import annotations

import base64
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import jinja2

from mnsf_ros import __version__
from mnsf_ros.drawing.figures import DARK, LIGHT
from mnsf_ros.drawing.side_by_side import animation
from mnsf_ros.evaluation.pictures import Pictures
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.report.charts import error_chart, time_chart
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.run_tables import RunTables, tiles_of
from mnsf_ros.report.text_table import format_number, format_percent
from mnsf_ros.sweeps.sweep import NANOSECONDS

REPORT_FILE: Final = "report.html"
_TEMPLATES: Final = jinja2.Environment(
    loader=jinja2.PackageLoader("mnsf_ros.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_report(
    folder: RunFolder, results: RunResults, tables: RunTables, num_pictured: int = 3
) -> Path:
    """Writes the report; an earlier one is replaced as a whole or not at all.

    So many of the worst sweeps are shown, those that the run has drawn.

    Returns:
        The file.

    Raises:
        WritingError: Writing fails.
    """
    cards, why_not = _cards(results, folder.pictures, num_pictured)
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        light=LIGHT,
        dark=DARK,
        results=results,
        tables=tables,
        tiles=tiles_of(results),
        error_chart=error_chart(results),
        time_chart=time_chart(results),
        animation=_animation(results, folder.pictures) if num_pictured else None,
        cards=cards,
        why_not=why_not,
    )
    path = folder.path / REPORT_FILE
    replace_file(path, [f"{page}\n"])
    return path


class Image(NamedTuple):
    """An image of the page: a data URI, a text for those who do not see it, a caption."""

    uri: str
    alt: str
    caption: str


class Card(NamedTuple):
    """A sweep with its images."""

    title: str
    subtitle: str
    images: list[Image]


def _cards(results: RunResults, pictures: Pictures, number: int) -> tuple[list[Card], str]:
    """The worst sweeps with pictures, and the reason for missing ones, empty if none."""
    worst = [_worst_card(results, row, pictures) for row in results.worst["row"][:number]]
    num_without, why_not = worst.count(None), ""
    if num_without:
        why_not = (
            f"{num_without} of {len(worst)} sweeps have no picture; a new run with --pictures "
            "draws more of the worst sweeps."
        )
    return list(filter(None, worst)), why_not


def _worst_card(results: RunResults, row: ResultRow, pictures: Pictures) -> Card | None:
    """A sweep with its pictures, that of the row first; None without one of the row."""
    references = results.record.references
    others = results.table["row"][~results.table["method"].isin([row.method, *references])]
    rivals = [one for one in others if one.sweep == row.sweep]
    images = []
    for one in (row, *rivals):
        image = pictures.find(one)
        if image is not None:
            caption = f"{one.method}: {_figures(one)}"
            where = f"sweep {row.number} of {row.recording} by {one.method}"
            alt = f"What moves in {where} beside the truth, and the errors; top view. {caption}."
            images.append(Image(_uri(image), alt, caption))
        elif one is row:
            return None
    subtitle = f"{row.stamp_ns / NANOSECONDS:.3f} s, {row.num_points:,} points"
    return Card(f"{row.recording}, sweep {row.number}", subtitle, images)


def _figures(row: ResultRow) -> str:
    errors, dynamic = row.errors.get("all"), row.errors.get("dynamic")
    if errors is None or errors.num_points == 0:
        return f"{format_number(row.badness_m, 3)} m from the moved points to the next sweep"
    text = f"EPE {errors.epe_m:.3f} m, Acc5 {format_percent(errors.acc5)} %"
    if dynamic is not None and dynamic.num_points:
        text += f", dynamic EPE {dynamic.epe_m:.3f} m"
    return text


def _animation(results: RunResults, pictures: Pictures) -> Image | None:
    """The first sweeps of a recording by the method under test, of the first that has frames."""
    own = results.table[results.table["method"] == results.focus]
    for recording in results.record.recordings:
        frames = pictures.frames(recording.name, results.focus)
        rows = own[(own["recording"] == recording.name) & own["number"].isin(frames)]
        if len(rows) > 1:
            interval_s = float(rows["stamp_ns"].diff().median()) / NANOSECONDS
            places = f"Left: truth. Right: {results.focus}." if recording.truth else results.focus
            caption = f"{recording.name}, the first {len(frames)} scored sweeps. {places}"
            alt = f"Animation of what moves in {caption}"
            with suppress(OSError, SyntaxError, ValueError):  # damaged frames
                images = animation(list(frames.values()), interval_s)
                return Image(_uri(images, "webp"), alt, caption)
    return None


def _uri(picture: bytes, kind: str = "png") -> str:
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"
