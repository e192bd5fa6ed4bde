"""The report of a run: one HTML file that needs nothing else, neither network nor scripts."""

from __future__ import annotations

import math
from collections.abc import Iterable
from pathlib import Path
from typing import Final

import jinja2

from mnsf_ros import __version__
from mnsf_ros.drawing.charts import time_text
from mnsf_ros.drawing.figures import DARK, LIGHT
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.evaluation.run_files import replace_file
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.presets import settings_for
from mnsf_ros.report.cards import missed_cards, worst_cards
from mnsf_ros.report.charts import charts_of
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.run_tables import RunTables
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_percent
from mnsf_ros.settings import declared_settings

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

    So many of the worst sweeps, and of the missed movers, get pictures if the run kept their flow.

    Returns:
        The file.

    Raises:
        WritingError: Writing fails.
    """
    summaries, record = results.summaries, results.record
    worst = worst_cards(results, folder.flows, num_pictured)
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        light=LIGHT,
        dark=DARK,
        tiles=[tile for one in summaries if one.method == results.focus for tile in _tiles(one)],
        results=results,
        best_cells=lambda table: best_cells(table, record.references),
        tables=tables,
        failures=[(f"{one.method}: {one.number:,} ×", one.text) for one in results.failures],
        charts=charts_of(results),
        worst_cards=worst,
        missed_cards=missed_cards(results, folder.flows, num_pictured),
        why_not=_why_not(min(num_pictured, len(results.worst)), len(worst)),
        settings=_settings_used(results),
    )
    path = folder.path / REPORT_FILE
    replace_file(path, [f"{page}\n"])
    return path


def _settings_used(results: RunResults) -> list[tuple[str, str]]:
    """The settings that the method under test reads, each with value and unit."""
    record = results.record
    settings = settings_for(results.focus, record.options.settings)
    traits = (one.traits for one in record.methods if one.name == results.focus)
    own = next((one.settings_groups for one in traits), None)
    return [
        (item.name, f"{settings.value_of(item.name)} {item.unit}".strip())
        for item in declared_settings()
        if own is None or item.group in (*_COMMON_GROUPS, *own)
    ]


def _why_not(num_wanted: int, num_found: int) -> str:
    """Why sweeps have no picture; empty if none were wanted, or all have one."""
    if num_found == num_wanted:
        return ""
    return (
        f"{num_wanted - num_found} of {num_wanted} sweeps have no picture: the run did not keep "
        "their flow. A new run with --pictures keeps that of the worst sweeps, with --write-flow "
        "that of all."
    )


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
