"""The sections of the report that come from figures alone: tiles, tables, charts, times."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from typing import Final

from mnsf_ros.drawing.charts import BandChart, band_chart, stage_bars, time_text
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import MethodSummary, mean
from mnsf_ros.evaluation.results_files import RunResults
from mnsf_ros.evaluation.results_tables import consistency_table, further_tables, main_tables
from mnsf_ros.evaluation.tables import TextTable, format_number, format_percent
from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.result_table import result_table, words_table

NO_FLOW: Final = "zero"
_REST: Final = "other"
_NUMBER: Final = re.compile(r"\d+(\.\d+)?")
_FIRST: Final = "the first one: "
# A smaller part of the time outside of all stages is not worth a color.
_REST_SHARE: Final = 0.02


def tiles(summary: MethodSummary) -> Html:
    """Returns what a method achieved in a few large figures."""
    figures = []
    errors = summary.errors.get("all")
    if errors is not None and errors.num_points > 0:
        figures += [
            (f"{errors.epe_m:.3f} m", "mean end point error"),
            (f"{format_percent(errors.acc5)} %", "points within 5 cm or 5 %"),
        ]
        dynamic = summary.errors.get("dynamic")
        if dynamic is not None and dynamic.num_points > 0:
            figures.append((f"{dynamic.epe_m:.3f} m", "error of points that move by themselves"))
    elif summary.consistency:
        nearest = summary.consistency.get("nearest_m", math.nan)
        unmoved = summary.consistency.get("zero_nearest_m", math.nan)
        figures.append((f"{format_number(nearest, 3)} m", "moved points to the next sweep"))
        if not math.isnan(unmoved):
            figures.append((f"{unmoved:.3f} m", "the same without any flow"))
        if not math.isnan(cycle := summary.consistency.get("cycle_m", math.nan)):
            figures.append((f"{cycle:.3f} m", "disagreement there and back"))
    figures.append((time_text(summary.time_ms), "for one flow"))
    if not math.isnan(summary.latency_ms):
        figures.append((time_text(summary.latency_ms), "from sweep to flow"))
    figures.append((f"{summary.num_examples:,}", "flows"))
    if summary.num_dropped or summary.num_failed:
        figures.append((f"{summary.num_dropped} / {summary.num_failed}", "dropped / failed"))
    tile = [
        element("div", element("b", value), element("span", text), class_="tile")
        for value, text in figures
    ]
    return element("div", *tile, class_="tiles")


def tables_section(results: RunResults) -> Html:
    """Returns the paper's table for all, dynamic and static points, and self-consistency."""
    consistency = consistency_table(results.summaries)
    title = "" if consistency is None else consistency.title
    tables = []
    for table in main_tables(results.summaries):
        notes = {title: "no proof of a right flow, but a wrong one shows"} if title else {}
        tables.append(result_table(table, notes.get(table.title, "")))
    return joined(*tables)


def bands_section(summaries: Sequence[MethodSummary]) -> Html:
    """Returns error against range and against speed; empty without truth."""
    charts: list[Html] = []
    # Nobody's flow is as wrong as none at all: its errors would flatten all others.
    summaries = [s for s in summaries if s.method != NO_FLOW] or summaries
    # One that failed everywhere has no line.
    summaries = [s for s in summaries if s.by_range or s.by_speed]
    for title, across, unit, part in _BANDS:
        limits = sorted({limit for s in summaries for limit in part(s)}, key=float)
        if not limits:
            continue
        values = {
            s.method: [part(s)[x].epe_m if x in part(s) else math.nan for x in limits]
            for s in summaries
        }
        chart = BandChart(title, f"{across} ({unit})", "EPE (m)", band_names(limits), values)
        heading = element("h3", title)
        charts.append(element("figure", heading, Html(band_chart(chart)), class_="card"))
    if not charts:
        return Html()
    return element("div", *charts, class_="pair")


def band_names(limits: Sequence[str]) -> list[str]:
    """Returns what bands are called, from their upper limits in ascending order."""
    names, low = [], "0"
    for limit in limits:
        names.append(f"{low}+" if limit == "inf" else f"{low}–{limit}")
        low = limit
    return names


def times_section(rows: Sequence[ResultRow], summaries: Sequence[MethodSummary]) -> Html:
    """Returns the time of each stage of each method; empty if no method was timed."""
    times_ms = stage_times_ms(rows, [summary.method for summary in summaries])
    if not times_ms:
        return Html()
    drawn = element("div", Html(stage_bars(times_ms)), class_="scroll")
    return element("figure", drawn, class_="card wide")


def stage_times_ms(
    rows: Sequence[ResultRow], methods: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Returns method to stage to mean time over its examples, milliseconds.

    What is in no stage is the stage `other`. Methods that were not timed are left out.
    """
    times_ms: dict[str, dict[str, float]] = {}
    for method in methods:
        own = [r for r in rows if r.method == method and not r.failure]
        whole = mean([row.time_ms for row in own])
        if math.isnan(whole):
            continue
        stages = dict.fromkeys(name for row in own for name in row.stage_times_ms)
        parts = {
            stage: mean([row.stage_times_ms.get(stage, 0.0) for row in own]) for stage in stages
        }
        rest = whole - math.fsum(parts.values())
        times_ms[method] = parts | ({_REST: rest} if rest > _REST_SHARE * whole else {})
    return times_ms


def failures_section(rows: Sequence[ResultRow]) -> Html:
    """Returns why examples have no flow, the most frequent reason first; empty if all have.

    Reasons that differ in numbers alone, such as stamps, are one: the first of them is told.
    """
    texts: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.failure:
            text = str(row.failure)
            texts.setdefault((row.method, _NUMBER.sub("#", text)), []).append(text)
    if not texts:
        return Html()
    lines = [
        (f"{method}: {len(found):,} ×", found[0] if len(set(found)) == 1 else f"{_FIRST}{found[0]}")
        for (method, _), found in sorted(texts.items(), key=lambda item: -len(item[1]))
    ]
    return element("div", words_table(lines, ("examples without a flow", "reason")), class_="card")


def more_tables(results: RunResults) -> Html:
    """Returns the tables for those who look closer, folded away."""
    tables = further_tables(results.summaries)
    shown = [result_table(table, mark_all=_is_error(table)) for table in tables]
    return element(
        "details",
        element("summary", f"{len(shown)} more table{'' if len(shown) == 1 else 's'}"),
        *shown,
    )


def _is_error(table: TextTable) -> bool:
    return "EPE" in table.title or "error" in table.title


def _by_range(summary: MethodSummary) -> dict[str, FlowErrors]:
    return summary.by_range


def _by_speed(summary: MethodSummary) -> dict[str, FlowErrors]:
    return summary.by_speed


_Part = Callable[[MethodSummary], dict[str, FlowErrors]]
_BANDS: Final[tuple[tuple[str, str, str, _Part], ...]] = (
    ("Error against range", "distance from the sensor", "m", _by_range),
    ("Error against speed", "true speed without the sensor's own motion", "m/s", _by_speed),
)
