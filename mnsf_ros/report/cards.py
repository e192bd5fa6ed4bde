"""Cards of the page: the worst sweeps and the missed movers of a method, in pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np

from mnsf_ros.drawing.example_pictures import ExamplePainter, PicturedExample, PicturedFlow
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.report.closer_look import CloserLook, MissedMover, badness
from mnsf_ros.report.text_table import format_number, format_percent

_NANOSECONDS: Final = 1e9
_SAME_M: Final = 1e-4
_ANOTHER: Final = (
    ". The picture shows another flow than that of the run: mean error {:.4f} m here, {:.4f} m in "
    "the run. {}"
)
_CARRIED: Final = (
    "The method had seen other sweeps in the run: earlier ones, or fewer in real time "
    "(--write-flow stores its flow); or code or machine differ"
)
_DIFFERS: Final = "Code or machine differ"


class Picture(NamedTuple):
    """A picture of the page: a data URI, what it shows for those who do not see it, a caption."""

    uri: str
    alt: str
    caption: str
    is_truth: bool = False


class Card(NamedTuple):
    """A sweep with its pictures."""

    title: str
    subtitle: str
    pictures: list[Picture]


class Cards(NamedTuple):
    """The cards of the worst sweeps, and those of the missed movers."""

    worst: list[Card]
    missed: list[Card]


def cards_of(
    rows: Sequence[ResultRow], look: CloserLook, examples: Sequence[PicturedExample]
) -> Cards:
    """Returns the cards of what is looked at, as far as there are examples of it.

    Other flows than that of the method are left out where they are zero everywhere.
    """
    by_key = {example.key: example for example in examples}
    worst = [by_key.get((row.recording, row.number)) for row in look.worst]
    missed = [(one, by_key.get((one.row.recording, one.row.number))) for one in look.missed]
    cards = [_missed_card(one, example) for one, example in missed if example is not None]
    return Cards(
        [_worst_card(rows, example, look.method) for example in worst if example is not None],
        [card for card in cards if card is not None],
    )


def _worst_card(rows: Sequence[ResultRow], example: PicturedExample, focus: str) -> Card:
    """A sweep with pictures of its truth and of the flow of each method."""
    painter = ExamplePainter(example)
    own = {row.method: row for row in rows if (row.recording, row.number) == example.key}
    where = f"sweep {example.number} of {example.recording}"
    pictures = []
    if true_picture := painter.truth():
        alt = f"True flow of {where} in top view, and what moves without ego motion."
        pictures.append(Picture(_uri(true_picture), alt, "Truth", is_truth=True))
    for item in example.flows:
        if item.method != focus and not np.nan_to_num(item.flow).any():
            continue
        said = _caption(item, own.get(item.method))
        alt = f"Flow of {where} by {item.method} and its {example.error_name}, top view. {said}."
        pictures.append(Picture(_uri(painter.method(item)), alt, said))
    subtitle = f"{example.stamp_ns / _NANOSECONDS:.3f} s, {len(example.xyz):,} points"
    return Card(f"{example.recording}, sweep {example.number}", subtitle, pictures)


def _missed_card(missed: MissedMover, example: PicturedExample) -> Card | None:
    """What moves around a missed mover, in truth and by the method; None if unknown."""
    flows = [item for item in example.flows if item.method == missed.row.method]
    png = ExamplePainter(example).around(flows[0], missed.item.place_m) if flows else None
    if png is None:
        return None
    item, row = missed.item, missed.row
    caption = f"{row.method}: missed in {missed.num_sweeps} sweeps, here lost by: {missed.lost_by}"
    caption += _origin(flows[0], missed.row)
    alt = f"What moves around the {item.kind} in top view, in truth and by {row.method}. {caption}."
    subtitle = (
        f"{row.stamp_ns / _NANOSECONDS:.3f} s, sweep {row.number}, {item.num_points:,} points, "
        f"{item.speed_m_s:.1f} m/s, {item.range_m:.0f} m away"
    )
    title = f"Missed: {item.kind} in {row.recording}"
    return Card(title, subtitle, [Picture(_uri(png), alt, caption)])


def _caption(item: PicturedFlow, row: ResultRow | None) -> str:
    """The figures of the run, and whether the picture is one of its flow."""
    return f"{item.method}{'' if row is None else f': {_figures(row)}'}{_origin(item, row)}"


def _origin(item: PicturedFlow, row: ResultRow | None) -> str:
    """How a flow was estimated again, and whether it is another one than that of the run."""
    text = ""
    if item.again is not None:
        number = item.again.num_before
        sweeps = "1 sweep" if number == 1 else f"{number} sweeps"
        after = f"after the {sweeps} before" if number else "from these sweeps alone"
        text = f". Estimated again for the picture, {after}"
    known_m = item.error_m[np.isfinite(item.error_m)]
    mean_m = float(known_m.mean()) if len(known_m) else math.nan
    if row is None or not abs(mean_m - badness(row)) > _SAME_M:
        return text
    is_carried = item.again is not None and item.again.num_before > 0
    why = _CARRIED if is_carried else _DIFFERS
    return text + _ANOTHER.format(mean_m, badness(row), why)


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
