# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The report of a run: one HTML file that needs nothing else, neither network nor scripts."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import jinja2

from mnsf_ros import __version__
from mnsf_ros.drawing.figures import DARK, LIGHT
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.report.cards import pictures_of
from mnsf_ros.report.charts import charts_of
from mnsf_ros.report.run_results import RunResults, failures_of
from mnsf_ros.report.run_tables import RunTables, tiles_of
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

    So many of the worst sweeps get pictures if the run kept their flow.

    Returns:
        The file.

    Raises:
        WritingError: Writing fails.
    """
    cards, why_not = pictures_of(results, folder.flows, num_pictured)
    page = _TEMPLATES.get_template("report.html.j2").render(
        version=__version__,
        light=LIGHT,
        dark=DARK,
        results=results,
        tables=tables,
        tiles=tiles_of(results),
        failures=failures_of(results.table),
        charts=charts_of(results),
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
