# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Cards of the page: the worst sweeps in pictures."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from mnsf_ros.drawing.example_pictures import ExamplePainter
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.shown_flows import ShownFlow, ShownFlows
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.text_table import format_number, format_percent
from mnsf_ros.sweeps.sweep import NANOSECONDS


class Picture(NamedTuple):
    """A picture of the page: a data URI, a text for those who do not see it, a caption."""

    uri: str
    alt: str
    caption: str
    is_truth: bool = False


class Card(NamedTuple):
    """A sweep with its pictures."""

    title: str
    subtitle: str
    pictures: list[Picture]


def pictures_of(results: RunResults, flows: ShownFlows, number: int) -> tuple[list[Card], str]:
    """Draws so many of the worst sweeps, as far as the run kept their flow.

    Returns:
        The cards, and the reason for missing ones; empty if all are there.
    """
    worst = [_worst_card(results, row, flows) for row in results.worst["row"][:number]]
    num_without, why_not = worst.count(None), ""
    if num_without:
        why_not = (
            f"{num_without} of {len(worst)} sweeps have no picture: the run did not keep their "
            "flow. A new run with --pictures keeps that of the worst sweeps, with --write-flow "
            "that of all."
        )
    return list(filter(None, worst)), why_not


def _worst_card(results: RunResults, row: ResultRow, flows: ShownFlows) -> Card | None:
    """A sweep with its truth and every flow that was kept; None without that of the row."""
    own = flows.find(row)
    if own is None:
        return None
    rivals = [one for one in results.table["row"] if one.sweep == row.sweep and one is not row]
    found = [(row, own), *((one, flow) for one in rivals if (flow := flows.find(one)) is not None)]
    painter = _painter([flow for _, flow in found])
    where = f"sweep {row.number} of {row.recording}"
    pictures = []
    if true_picture := painter.truth():
        alt = f"True flow of {where} in top view, and its part without ego motion."
        pictures.append(Picture(_uri(true_picture), alt, "Truth", is_truth=True))
    for one, item in found:
        if one is row or np.nan_to_num(item.flow).any():
            caption = f"{one.method}: {_figures(one)}"
            picture = painter.method(one.method, item.flow, item.error_m)
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


def _uri(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
