"""The worst examples first: a list with figures, and pictures of some."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from typing import Final

import numpy as np

from mnsf_ros.drawing.example_pictures import ExamplePainter, PicturedExample, PicturedFlow
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.tables import TextTable, format_number, format_percent
from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.pictured import badness, worst_rows
from mnsf_ros.report.result_table import result_table

_NUM_LISTED: Final = 10
_NANOSECONDS: Final = 1e9
_SAME_M: Final = 1e-3
_AGAIN: Final = "Estimated again for the picture"
_ANOTHER: Final = "The picture shows another flow than that of the run: code or machine differ"
_FROM_SCRATCH: Final = (
    "That was in the run. The picture is a new estimate from these sweeps alone, with a mean of "
    "{mean:.3f} m: in the run the method may have gone on from its last estimate (--write-flow "
    "keeps that), else code or machine differ"
)
_HINT: Final = (
    "Seen from above, x forward and y left in metres; the white triangle is the sensor. Color: "
    "direction and speed by the wheel, grey where slow; arrows: the way in 5 sweeps. What moves is "
    "the flow without the sensor's own motion. All pictures of an example have the same scales."
)


def worst_section(
    rows: Sequence[ResultRow], method: str, pictured: Sequence[PicturedExample]
) -> Html:
    """Returns the worst examples of a method.

    Args:
        rows: All rows of the run.
        method: Whose worst examples.
        pictured: Examples to show in pictures, the worst one first.
    """
    if not worst_rows(rows, method):
        return element("p", "No example has both a flow and something to judge it by.")
    cards = [_card(rows, example) for example in pictured]
    hint = [element("p", _HINT, class_="faint")] if cards else []
    return joined(*hint, *cards, result_table(worst_table(rows, method), are_rivals=False))


def worst_table(rows: Sequence[ResultRow], method: str) -> TextTable:
    """Returns the figures of the worst examples of a method, the worst one first."""
    worst = worst_rows(rows, method)
    has_truth = any(row.errors for row in worst)
    header = ["sweep", "points"]
    header += ["EPE (m)", "Acc5 (%)", "dynamic EPE (m)"] if has_truth else []
    header += ["to next sweep (m)", "time (ms)"]
    listed = [_cells(row, has_truth) for row in worst[:_NUM_LISTED]]
    title = f"The worst {len(listed)} of {len(worst)} examples of {method}"
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
    nearest = row.consistency.get("nearest_m", float("nan"))
    return [*cells, format_number(nearest, 3), format_number(row.time_ms, 0)]


def _card(rows: Sequence[ResultRow], example: PicturedExample) -> Html:
    painter = ExamplePainter(example)
    own = {row.method: row for row in rows if (row.recording, row.number) == example.key}
    parts = [
        element("h3", f"{example.recording}, sweep {example.number}"),
        element(
            "p",
            f"{example.stamp_ns / _NANOSECONDS:.3f} s, {len(example.xyz):,} points",
            class_="faint",
        ),
    ]
    where = f"sweep {example.number} of {example.recording}"
    true_picture = painter.truth()
    if true_picture is not None:
        alt = f"True flow of {where}, from above, and what moves by itself."
        parts.append(_picture(true_picture, alt, "Truth", "picture truth"))
    for item in example.flows:
        row = own.get(item.method)
        said = item.method if row is None else f"{item.method}: {_said(row)}"
        is_another = row is not None and _is_another(row, item)
        if item.is_again:
            mean_m = float(np.nanmean(item.error_m)) if is_another else 0.0
            said += f". {_FROM_SCRATCH.format(mean=mean_m) if is_another else _AGAIN}"
        elif is_another:
            said += f". {_ANOTHER}"
        alt = f"Flow of {where} by {item.method} and its {example.error_name}, from above. {said}."
        parts.append(_picture(painter.method(item), alt, said))
    return element("section", *parts, class_="card long")


def _is_another(row: ResultRow, item: PicturedFlow) -> bool:
    """Whether a flow is not the one that the row of the run is about."""
    known = item.error_m[np.isfinite(item.error_m)]
    return len(known) > 0 and abs(float(known.mean()) - badness(row)) > _SAME_M


def _said(row: ResultRow) -> str:
    errors = row.errors.get("all")
    if errors is None or errors.num_points == 0:
        return f"{format_number(badness(row), 3)} m from the moved points to the next sweep"
    text = f"EPE {errors.epe_m:.3f} m, Acc5 {format_percent(errors.acc5)} %"
    dynamic = row.errors.get("dynamic")
    if dynamic is not None and dynamic.num_points:
        text += f", EPE of what moves {dynamic.epe_m:.3f} m"
    return text


def _picture(png: bytes, alt: str, caption: str, kind: str = "picture") -> Html:
    uri = "data:image/png;base64," + base64.b64encode(png).decode("ascii")
    image = element("img", src=uri, alt=alt, loading="lazy")
    return element("figure", image, element("figcaption", caption), class_=kind)
