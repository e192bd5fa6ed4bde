"""The report of a run: one HTML file that needs nothing else, neither network nor scripts."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Final

import jinja2
from markupsafe import Markup

from mnsf_ros import __version__
from mnsf_ros.drawing.charts import stage_bars, time_text
from mnsf_ros.drawing.figures import DARK, LIGHT
from mnsf_ros.evaluation.results import MethodSummary, ResultRow, mean
from mnsf_ros.evaluation.run_folder import replace_file
from mnsf_ros.presets import settings_for
from mnsf_ros.report.cards import Cards
from mnsf_ros.report.closer_look import CloserLook, missed_table, worst_table
from mnsf_ros.report.comparison import comparison_tables
from mnsf_ros.report.error_charts import bin_charts, methods_not_drawn, point_charts
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import consistency_table, further_tables, main_tables
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_percent
from mnsf_ros.settings import declared_settings

REPORT_FILE: Final = "report.html"
_REST: Final = "other"
# A smaller part of the time outside of all stages is not worth a color.
_REST_SHARE: Final = 0.02
_NUMBER: Final = re.compile(r"\d+(\.\d+)?")
_TEMPLATES: Final = jinja2.Environment(
    loader=jinja2.PackageLoader("mnsf_ros.report"),
    autoescape=True,
    undefined=jinja2.StrictUndefined,
    trim_blocks=True,
    lstrip_blocks=True,
)


def write_report(
    results: RunResults,
    path: Path,
    look: CloserLook,
    cards: Cards,
    why_not: str = "",
) -> None:
    """Writes the report; an earlier one is replaced as a whole or not at all.

    `why_not` says why sweeps have no pictures.

    Raises:
        WritingError: Writing fails.
    """
    rows, summaries, record = results.rows, results.summaries, results.record
    consistency = consistency_table(summaries)
    units = {setting.name: setting.unit for setting in declared_settings()}
    settings = settings_for(look.method, record.options.settings).to_mapping()
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        light=LIGHT,
        dark=DARK,
        tiles=[tile for one in summaries if one.method == look.method for tile in _tiles(one)],
        results=results,
        best_cells=lambda table: best_cells(table, record.references),
        tables=[table for table in main_tables(summaries) if table != consistency],
        comparison=comparison_tables(results),
        consistency=consistency,
        more=further_tables(summaries),
        failures=_failures(rows),
        charts=bin_charts(summaries, record.references),
        wide_charts=point_charts(rows, summaries, record.references),
        times=_times_chart(rows, summaries),
        focus=look.method,
        worst=worst_table(look),
        missed=missed_table(look),
        cards=cards,
        why_not=why_not,
        settings=[(k, f"{value} {units.get(k, '')}".strip()) for k, value in settings.items()],
        not_drawn=methods_not_drawn(summaries, record.references),
    )
    replace_file(path, [f"{page}\n"])


def _tiles(summary: MethodSummary) -> list[tuple[str, str]]:
    """What a method achieved in a few large figures."""
    figures = []
    errors, dynamic = summary.errors.get("all"), summary.errors.get("dynamic")
    if errors is not None and errors.num_points > 0:
        figures += [
            (f"{errors.epe_m:.3f} m", "mean end point error"),
            (f"{format_percent(errors.acc5)} %", "points within 5 cm or 5 %"),
        ]
        if dynamic is not None and dynamic.num_points > 0:
            figures.append((f"{dynamic.epe_m:.3f} m", "error of dynamic points"))
    elif summary.consistency:
        for key, text in (
            ("nearest_m", "moved points to the next sweep"),
            ("zero_nearest_m", "the same without any flow"),
            ("cycle_m", "forward-backward disagreement"),
        ):
            value = summary.consistency.get(key, math.nan)
            if not math.isnan(value):
                figures.append((f"{value:.3f} m", text))
    figures.append((time_text(summary.time_ms), "run time per sweep"))
    if not math.isnan(summary.latency_ms):
        figures.append((time_text(summary.latency_ms), "from sweep to flow"))
    figures.append((f"{summary.num_examples:,}", "flows"))
    if summary.num_dropped or summary.num_failed:
        figures.append((f"{summary.num_dropped} / {summary.num_failed}", "dropped / failed"))
    return figures


def best_cells(table: TextTable, references: Iterable[str]) -> set[tuple[int, int]]:
    """Returns row and column of the best values: of columns that have one, if rows compete.

    Rows of references only show what an error is worth, and never are the best.
    """
    best = set()
    for column, better in enumerate(table.better):
        values = {
            place: float(row[column])
            for place, row in enumerate(table.rows)
            if better and row[0] not in references and row[column] != NO_VALUE
        }
        if better and len(set(values.values())) > 1:
            best_value = better(values.values())
            best |= {(place, column) for place, value in values.items() if value == best_value}
    return best


def _failures(rows: Iterable[ResultRow]) -> list[tuple[str, str]]:
    """Why sweeps have no flow, the most frequent reason first.

    Reasons that differ in numbers alone, such as stamps, are one: the first of them is told.
    """
    texts: dict[tuple[str, str], list[str]] = {}
    for row in rows:
        if row.failure is not None:
            text = row.failure.text
            texts.setdefault((row.method, _NUMBER.sub("#", text)), []).append(text)
    return [
        (
            f"{method}: {len(found):,} ×",
            found[0] if len(set(found)) == 1 else f"the first one: {found[0]}",
        )
        for (method, _), found in sorted(texts.items(), key=lambda item: -len(item[1]))
    ]


def _times_chart(rows: Sequence[ResultRow], summaries: Sequence[MethodSummary]) -> Markup:
    times_ms = stage_times_ms(rows, [summary.method for summary in summaries])
    return Markup(stage_bars(times_ms) if times_ms else "")


def stage_times_ms(
    rows: Sequence[ResultRow], methods: Sequence[str]
) -> dict[str, dict[str, float]]:
    """Returns method to stage to mean time over its sweeps, milliseconds.

    What is in no stage is the stage `other`. Methods that were not timed are left out.
    """
    times_ms: dict[str, dict[str, float]] = {}
    for method in methods:
        own = [row for row in rows if row.method == method and row.failure is None]
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
