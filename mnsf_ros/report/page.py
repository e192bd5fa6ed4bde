# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file with all of its pictures, without network or scripts."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import jinja2
import numpy as np

from mnsf_ros import __version__
from mnsf_ros.drawing.example_pictures import ExamplePainter
from mnsf_ros.drawing.figures import DARK, LIGHT
from mnsf_ros.drawing.side_by_side import animation
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.evaluation.shown_flows import ShownFlow, ShownFlows
from mnsf_ros.report.charts import charts_of
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.run_tables import RunTables, tiles_of
from mnsf_ros.report.text_table import format_number, format_percent
from mnsf_ros.settings import declared_settings
from mnsf_ros.sweeps.sweep import NANOSECONDS

REPORT_FILE: Final = "report.html"
# Groups of settings that say which points there are, and where; every method has them.
_COMMON_GROUPS: Final = ("method", "time", "crop", "ground", "buffer", "ego_motion", "compute")
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

    So many of the worst sweeps get pictures if the run kept their flow.

    Returns:
        The file.

    Raises:
        WritingError: Writing fails.
    """
    cards, why_not = _cards(results, folder.flows, num_pictured)
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        light=LIGHT,
        dark=DARK,
        results=results,
        tables=tables,
        tiles=tiles_of(results),
        charts=charts_of(results),
        animation=_animation(results, folder.flows) if num_pictured else None,
        cards=cards,
        why_not=why_not,
        settings=_settings_used(results),
    )
    path = folder.path / REPORT_FILE
    replace_file(path, [f"{page}\n"])
    return path


def _settings_used(results: RunResults) -> list[tuple[str, str]]:
    """The settings that the method under test reads, each with value and unit."""
    settings = results.used_settings[results.focus].settings
    traits = (one.traits for one in results.record.methods if one.name == results.focus)
    own = next((one.settings_groups for one in traits), None)
    return [
        (item.name, f"{settings.value_of(item.name)} {item.unit}".strip())
        for item in declared_settings()
        if own is None or item.group in (*_COMMON_GROUPS, *own)
    ]


class Picture(NamedTuple):
    """A picture of the page: a data URI, a text for those who do not see it, a caption."""

    uri: str
    alt: str
    caption: str


class Card(NamedTuple):
    """A sweep with its pictures."""

    title: str
    subtitle: str
    pictures: list[Picture]


def _cards(results: RunResults, flows: ShownFlows, number: int) -> tuple[list[Card], str]:
    """The worst sweeps whose flow was kept, and the reason for missing ones, empty if none."""
    worst = [_worst_card(results, row, flows) for row in results.worst["row"][:number]]
    num_without, why_not = worst.count(None), ""
    if num_without:
        why_not = (
            f"{num_without} of {len(worst)} sweeps have no picture: the run did not keep their "
            "flow. A new run with --pictures keeps the flow of the worst sweeps."
        )
    return list(filter(None, worst)), why_not


def _worst_card(results: RunResults, row: ResultRow, flows: ShownFlows) -> Card | None:
    """A sweep with all kept flows beside the truth; None if the flow of the row was not kept."""
    own = flows.find(row)
    if own is None:
        return None
    rivals = [one for one in results.table["row"] if one.sweep == row.sweep and one is not row]
    found = [(row, own), *((one, flow) for one in rivals if (flow := flows.find(one)) is not None)]
    painter = _painter([flow for _, flow in found])
    where = f"sweep {row.number} of {row.recording}"
    pictures = []
    for one, item in found:
        if one is row or np.nan_to_num(item.flow).any():
            caption = f"{one.method}: {_figures(one)}"
            picture = painter.picture(one.method, item.flow, item.error_m)
            alt = f"Flow of {where} by {one.method} and its {painter.error_name}, top view. "
            pictures.append(Picture(_uri(picture), f"{alt}{caption}.", caption))
    subtitle = f"{row.stamp_ns / NANOSECONDS:.3f} s, {len(own.xyz):,} points"
    return Card(f"{row.recording}, sweep {row.number}", subtitle, pictures)


def _painter(flows: Sequence[ShownFlow]) -> ExamplePainter:
    first = flows[0]
    return ExamplePainter(first.xyz, [one.flow for one in flows], first.truth, first.ego_motion)


def _figures(row: ResultRow) -> str:
    errors, dynamic = row.errors.get("all"), row.errors.get("dynamic")
    if errors is None or errors.num_points == 0:
        return f"{format_number(row.badness_m, 3)} m from the moved points to the next sweep"
    text = f"EPE {errors.epe_m:.3f} m, Acc5 {format_percent(errors.acc5)} %"
    if dynamic is not None and dynamic.num_points:
        text += f", dynamic EPE {dynamic.epe_m:.3f} m"
    return text


def _animation(results: RunResults, flows: ShownFlows) -> Picture | None:
    """The first sweeps of a recording by the method under test, of the first that has frames."""
    own = results.table[results.table["method"] == results.focus]
    for recording in results.record.recordings:
        frames = flows.frames(recording.name, results.focus)
        rows = own[(own["recording"] == recording.name) & own["number"].isin(frames)]
        if len(rows) > 1:
            interval_s = float(rows["stamp_ns"].diff().median()) / NANOSECONDS
            places = f"Left: truth. Right: {results.focus}." if recording.truth else results.focus
            caption = f"{recording.name}, the first {len(frames)} scored sweeps. {places}"
            alt = f"Animation of what moves in {caption}"
            return Picture(_uri(animation(list(frames.values()), interval_s), "webp"), alt, caption)
    return None


def _uri(picture: bytes, kind: str = "png") -> str:
    return f"data:image/{kind};base64,{base64.b64encode(picture).decode('ascii')}"
