"""The worst sweeps of a method: a table of figures, and cards with pictures."""

from __future__ import annotations

import base64
import math
from collections.abc import Iterable, Sequence
from typing import Final, NamedTuple

import numpy as np

from mnsf_ros.drawing.example_pictures import ExamplePainter, PicturedExample, PicturedFlow
from mnsf_ros.evaluation.movers import ObjectRow
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_results import RunResults
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_number, format_percent

_NUM_LISTED: Final = 10
_NANOSECONDS: Final = 1e9
_SAME_M: Final = 1e-3
_AGAIN: Final = ". Estimated again for the picture, from these sweeps alone"
_ANOTHER: Final = (
    ". The picture shows another flow than that of the run, with a mean error of {:.3f} m: the "
    "method had continued from its last estimate (--write-flow stores such flow), or code or "
    "machine differ"
)


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


class MissedMover(NamedTuple):
    """A mover that was missed, in the sweep in which there was most to be seen of it."""

    row: ResultRow
    item: ObjectRow
    num_sweeps: int

    @property
    def lost_by(self) -> str:
        """What lost it, a dash if nobody says."""
        return NO_VALUE if self.item.lost_by is None else self.item.lost_by.value


def missed_movers(rows: Iterable[ResultRow], method: str) -> list[MissedMover]:
    """Returns the movers that a method did not find in some sweep, the one of most sweeps first."""
    missed: dict[tuple[str, int], list[tuple[ResultRow, ObjectRow]]] = {}
    for row in rows:
        if row.method == method and row.movers is not None:
            for item in row.movers.objects:
                if item.moves and not item.is_found:
                    missed.setdefault((row.recording, item.object_id), []).append((row, item))
    most = (
        (*max(sweeps, key=lambda pair: (pair[1].num_points, -pair[0].number)), len(sweeps))
        for sweeps in missed.values()
    )
    return sorted((MissedMover(*one) for one in most), key=lambda one: -one.num_sweeps)


def missed_table(rows: Iterable[ResultRow], method: str) -> TextTable | None:
    """Returns the movers that a method missed most often; None if it missed none."""
    header = ["mover", "sweeps", "stamp (s)", "x, y (m)", "speed (m/s)", "points", "lost by"]
    listed = [
        [
            f"{one.row.recording}: {one.item.kind}",
            str(one.num_sweeps),
            f"{one.row.stamp_ns / _NANOSECONDS:.3f}",
            ", ".join(f"{value:.1f}" for value in one.item.place_m),
            f"{one.item.speed_m_s:.1f}",
            f"{one.item.num_points:,}",
            one.lost_by,
        ]
        for one in missed_movers(rows, method)[:_NUM_LISTED]
    ]
    title = f"Movers that {method} missed in most sweeps (mnsf explain tells more of a place)"
    return TextTable(header, listed, title) if listed else None


def missed_card(missed: MissedMover, example: PicturedExample) -> Card | None:
    """Returns what moves around a missed mover, in truth and by the method; None if unknown."""
    flows = [item for item in example.flows if item.method == missed.row.method]
    png = ExamplePainter(example).around(flows[0], missed.item.place_m) if flows else None
    if png is None:
        return None
    item, row = missed.item, missed.row
    caption = f"{row.method}: missed in {missed.num_sweeps} sweeps, here lost by: {missed.lost_by}"
    caption += _AGAIN if flows[0].is_again else ""
    alt = f"What moves around the {item.kind} in top view, in truth and by {row.method}. {caption}."
    subtitle = (
        f"{row.stamp_ns / _NANOSECONDS:.3f} s, sweep {row.number}, {item.num_points:,} points, "
        f"{item.speed_m_s:.1f} m/s, {item.range_m:.0f} m away"
    )
    title = f"Missed: {item.kind} in {row.recording}"
    return Card(title, subtitle, [Picture(_uri(png), alt, caption)])


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


def worst_card(rows: Sequence[ResultRow], example: PicturedExample, focus: str) -> Card:
    """Returns a sweep with pictures of its truth and of the flow of each method.

    Other flows than that of the method in focus are left out where they are zero everywhere.
    """
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


def _caption(item: PicturedFlow, row: ResultRow | None) -> str:
    """The figures of the run, and whether the picture is one of its flow."""
    again = _AGAIN if item.is_again else ""
    if row is None:
        return f"{item.method}{again}"
    text = f"{item.method}: {_figures(row)}{again}"
    known_m = item.error_m[np.isfinite(item.error_m)]
    mean_m = float(known_m.mean()) if len(known_m) else math.nan
    return text + (_ANOTHER.format(mean_m) if abs(mean_m - badness(row)) > _SAME_M else "")


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
