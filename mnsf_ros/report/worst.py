"""The worst sweeps of a method: a table of figures, and cards with pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from mnsf_ros.drawing.example_pictures import ExamplePainter, PicturedExample, PicturedFlow
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results_files import RunResults
from mnsf_ros.evaluation.tables import TextTable, format_number, format_percent

_NUM_LISTED: Final = 10
_NANOSECONDS: Final = 1e9
_SAME_M: Final = 1e-3
_AGAIN: Final = "Estimated again for the picture"
_ANOTHER: Final = "The picture shows another flow than that of the run: code or machine differ"
_FROM_SCRATCH: Final = (
    "These are figures of the run. The picture is a new estimate from these sweeps alone, with a "
    "mean error of {mean:.3f} m: in the run the method may have continued from its last estimate "
    "(--write-flow stores that flow), or code or machine differ"
)


@dataclass(frozen=True)
class Picture:
    """A picture of the page.

    Attributes:
        uri: The picture itself, as a data URI.
        alt: What it shows, for those who do not see it.
        caption: The line below it.
        is_truth: Whether it shows the truth, which has one panel less.
    """

    uri: str
    alt: str
    caption: str
    is_truth: bool = False


@dataclass(frozen=True)
class Card:
    """A sweep with its pictures."""

    title: str
    subtitle: str
    pictures: list[Picture]


def badness(row: ResultRow) -> float:
    """Returns how bad a flow is: its error, or without truth the distance it leaves; metres."""
    errors = row.errors.get("all")
    if errors is not None and errors.num_points > 0:
        return errors.epe_m
    return row.consistency.get("nearest_m", math.nan)


def worst_rows(rows: Iterable[ResultRow], method: str) -> list[ResultRow]:
    """Returns the rows of a method that have a flow, the worst one first."""
    own = [row for row in rows if row.method == method and row.failure is None]
    known = [row for row in own if not math.isnan(badness(row))]
    return sorted(known, key=lambda row: (-badness(row), row.recording, row.number))


def focus_method(results: RunResults) -> str:
    """Returns the method to look at closely: the first one with a flow that is no reference."""
    references = results.record.references
    found = [summary.method for summary in results.summaries if summary.num_examples]
    rivals = [method for method in found if method not in references]
    return next(iter(rivals or found), "")


def worst_table(rows: Sequence[ResultRow], method: str) -> TextTable | None:
    """Returns the figures of the worst sweeps of a method; None if none can be judged."""
    worst = worst_rows(rows, method)
    if not worst:
        return None
    has_truth = any(row.errors for row in worst)
    header = ["sweep", "points"]
    header += ["EPE (m)", "Acc5 (%)", "dynamic EPE (m)"] if has_truth else []
    header += ["to next sweep (m)", "time (ms)"]
    listed = [_cells(row, has_truth) for row in worst[:_NUM_LISTED]]
    title = f"The worst {len(listed)} of {len(worst)} sweeps of {method}"
    return TextTable(header, listed, title)


def _cells(row: ResultRow, has_truth: bool) -> list[str]:
    cells = [f"{row.recording}, sweep {row.number}", f"{row.num_points:,}"]
    if has_truth:
        errors, dynamic = row.errors.get("all"), row.errors.get("dynamic")
        cells += [
            "-" if errors is None else format_number(errors.epe_m, 3),
            "-" if errors is None else format_percent(errors.acc5),
            "-" if dynamic is None else format_number(dynamic.epe_m, 3),
        ]
    nearest_m = row.consistency.get("nearest_m", math.nan)
    return [*cells, format_number(nearest_m, 3), format_number(row.time_ms, 0)]


def worst_cards(rows: Sequence[ResultRow], pictured: Iterable[PicturedExample]) -> list[Card]:
    """Returns a card for each sweep, with its truth and the flow of each method."""
    return [_card(rows, example) for example in pictured]


def _card(rows: Sequence[ResultRow], example: PicturedExample) -> Card:
    painter = ExamplePainter(example)
    own = {row.method: row for row in rows if (row.recording, row.number) == example.key}
    where = f"sweep {example.number} of {example.recording}"
    pictures = []
    true_picture = painter.truth()
    if true_picture is not None:
        alt = f"True flow of {where} in top view, and what moves without ego motion."
        pictures.append(Picture(_uri(true_picture), alt, "Truth", is_truth=True))
    for item in example.flows:
        said = _caption(item, own.get(item.method))
        alt = f"Flow of {where} by {item.method} and its {example.error_name}, top view. {said}."
        pictures.append(Picture(_uri(painter.method(item)), alt, said))
    subtitle = f"{example.stamp_ns / _NANOSECONDS:.3f} s, {len(example.xyz):,} points"
    return Card(f"{example.recording}, sweep {example.number}", subtitle, pictures)


def _caption(item: PicturedFlow, row: ResultRow | None) -> str:
    if row is None:
        return f"{item.method}. {_AGAIN}" if item.is_again else item.method
    text = f"{item.method}: {_figures(row)}"
    known_m = item.error_m[np.isfinite(item.error_m)]
    mean_m = float(known_m.mean()) if len(known_m) else math.nan
    is_another = abs(mean_m - badness(row)) > _SAME_M
    if item.is_again:
        return f"{text}. {_FROM_SCRATCH.format(mean=mean_m) if is_another else _AGAIN}"
    return f"{text}. {_ANOTHER}" if is_another else text


def _figures(row: ResultRow) -> str:
    errors, dynamic = row.errors.get("all"), row.errors.get("dynamic")
    if errors is None or errors.num_points == 0:
        return f"{format_number(badness(row), 3)} m from the moved points to the next sweep"
    text = f"EPE {errors.epe_m:.3f} m, Acc5 {format_percent(errors.acc5)} %"
    if dynamic is not None and dynamic.num_points:
        text += f", dynamic EPE {dynamic.epe_m:.3f} m"
    return text


def _uri(png: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(png).decode('ascii')}"
