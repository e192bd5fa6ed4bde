# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file with all of its pictures, without network or scripts."""

from __future__ import annotations

import base64
import math
from contextlib import suppress
from pathlib import Path
from typing import Final, NamedTuple

import jinja2
import pandas as pd
from markupsafe import Markup

from mnsf_ros import __version__
from mnsf_ros.drawing.charts import curve_chart, stage_bars
from mnsf_ros.drawing.figures import DARK, LIGHT
from mnsf_ros.drawing.side_by_side import animation
from mnsf_ros.evaluation.pictures import Pictures
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.evaluation.summary import errors_by_sweep, part_of
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.run_tables import tiles_of
from mnsf_ros.report.text_table import format_number, format_percent
from mnsf_ros.sweeps.sweep import NANOSECONDS

REPORT_FILE: Final = "report.html"
_REST: Final = "other"
# A smaller part of the time outside of all stages is not worth a colour.
_REST_SHARE: Final = 0.02
_TEMPLATES: Final = jinja2.Environment(
    loader=jinja2.PackageLoader("mnsf_ros.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_report(folder: RunFolder, results: RunResults, num_pictured: int = 3) -> Path:
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
        tables=results.tables,
        tiles=tiles_of(results),
        error_chart=_error_chart(results),
        time_chart=_time_chart(results),
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


def _error_chart(results: RunResults) -> Markup:
    """The errors of sweeps, references only among themselves; empty with fewer than two."""
    errors_m = errors_by_sweep(results.table, "all")
    scored = [name for name in results.summary.index if name in errors_m]
    shown = [name for name in scored if name not in results.record.references] or scored
    errors_m = errors_m.reindex(columns=shown).dropna(how="all")
    if len(errors_m) < 2:
        return Markup()
    places = errors_m.index.get_level_values("number").tolist()
    across = "number of the sweep, as in the tables"
    if (num_recordings := errors_m.index.get_level_values("recording").nunique()) > 1:
        places = list(range(1, len(errors_m) + 1))
        across = f"scored sweeps, counted from 1, {num_recordings} recordings in a row"
    return Markup(curve_chart("Error of each sweep", across, places, errors_m.to_dict("list")))


def _time_chart(results: RunResults) -> Markup:
    """The time of each stage; empty if nothing was timed."""
    found = stage_times_ms(results.table)
    times_ms = {name: found[name] for name in results.summary.index if name in found}
    return Markup(stage_bars(times_ms) if times_ms else "")


def stage_times_ms(table: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Returns method to stage to mean wall time in milliseconds; `other` is outside of all stages.

    `table` is a `summary.row_table`. Methods without times are missing.
    """
    timed = table.loc[[row.failure is None and row.time_ms >= 0 for row in table["row"]]]
    found: dict[str, dict[str, float]] = {}
    for method, own in timed.groupby("method", sort=False):
        times_ms = part_of(own, "stage_times_ms").fillna(0.0).mean().to_dict()
        whole_ms = own["time_ms"].mean()
        rest_ms = whole_ms - math.fsum(times_ms.values())
        found[str(method)] = times_ms | (
            {_REST: rest_ms} if rest_ms > _REST_SHARE * whole_ms else {}
        )
    return found
