# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Effect of the warm start: errors over the sweeps since the start, warm and from scratch."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

import pandas as pd

from mnsf_ros.drawing.charts import curves
from mnsf_ros.presets import settings_for
from mnsf_ros.report.text_table import TextTable, format_number
from mnsf_ros.settings import Settings
from mnsf_ros.studies.settings import CaseStudySettings, numbers_of
from mnsf_ros.studies.study import StudyOptions, StudyResult, texts_on

_TITLE: Final = "Warm start: errors over the sweeps since the start"
_LIVE: Final = "mnsf/mnsf"
_GROUPS: Final = ("dynamic", "static")
# Parts of a recording, by the number of the sweep since the start: first and last.
_PARTS: Final = ((1, 3), (4, 10), (11, math.inf))
# Name of a family of curves to the names of its variants, each to its method.
_Families = Mapping[str, Mapping[str, str]]


def run(_name: str, options: StudyOptions) -> StudyResult:
    """Evaluates the variants on the first recording, from its first sweep on.

    Raises:
        MnsfError: A recording or a setting cannot be used, or no example can be scored.
        OSError: Writing fails.
    """
    # Live methods look at all points.
    settings = settings_for(_LIVE, options.evaluation.settings)
    evaluation = replace(options.evaluation, settings=settings, num_points=0)
    families = _families(options.case)
    variants = {name: method for own in families.values() for name, method in own.items()}
    results = options.evaluated(variants.values(), evaluation, options.recordings[:1])
    numbers = _numbers(results.table, variants)
    texts = [_text(settings), *texts_on(results)]
    tables = [_table(numbers, group) for group in _GROUPS]
    title = f"Warm start, and from scratch: {options.recordings[0].name}"
    picture = _picture(title, numbers, families)
    return StudyResult(_TITLE, texts, tables, numbers, evaluation, picture)


def _families(case: CaseStudySettings) -> _Families:
    warm = f"{_LIVE}+optimization.max_iterations"
    cold = f"{_LIVE}+warm_start.enabled=false+live.first_iterations"
    return {
        "warm": {f"warm, {_steps(k)}": f"{warm}={k}" for k in numbers_of(case.warm_steps)},
        "cold": {f"cold, {_steps(k)}": f"{cold}={k}" for k in numbers_of(case.cold_steps)},
        "online": {"online": "online"},
    }


def _steps(number: int) -> str:
    return "1 step" if number == 1 else f"{number} steps"


def _text(settings: Settings) -> str:
    return (
        f"Warm: the networks go on from sweep to sweep. They take {settings.live.first_iterations} "
        "steps each at the first sweep, then the given number for both fields and "
        f"{settings.fusion.max_iterations} for the fusion. Cold: fresh networks for every sweep, "
        "which take the given number of steps each, and no tracks from earlier sweeps either. "
        "online fits no networks. The first estimate is that of the first sweep with one before "
        "and one after it. Time is the median wall time of an estimate, with crop, ground and ego "
        "motion."
    )


def _numbers(table: pd.DataFrame, variants: Mapping[str, str]) -> pd.DataFrame:
    """A line for each variant and sweep, from a table of rows."""
    columns = {"variant": "variant", "method": "method", "number": "sweep", "since": "since_start"}
    for group in _GROUPS:
        columns[f"errors.{group}.epe_m"] = f"{group}_epe_m"
        columns[f"errors.{group}.num_points"] = f"{group}_num_points"
    columns["time_ms"] = "time_ms"
    rows = pd.concat(table[table["method"] == m].assign(variant=n) for n, m in variants.items())
    first = rows.groupby("variant")["number"].transform("first")
    rows = rows.assign(since=rows["number"] - first + 1).reindex(columns=list(columns))
    counts = {f"{group}_num_points": int for group in _GROUPS}
    numbers = rows.rename(columns=columns)
    return numbers.fillna(dict.fromkeys(counts, 0)).astype(counts)


def _table(numbers: pd.DataFrame, group: str) -> TextTable:
    """Mean EPE of a group of points in each part of the recording, each sweep counting the same."""
    header = ["variant", *(f"sweeps {_part_text(*part)}" for part in _PARTS), "time (ms)"]
    cells = []
    for name, own in numbers.groupby("variant", sort=False):
        parts = [own[own["since_start"].between(*part)] for part in _PARTS]
        means = [format_number(part[f"{group}_epe_m"].mean(), 3) for part in parts]
        cells.append([str(name), *means, format_number(own["time_ms"].median(), 0)])
    return TextTable(header, cells, f"EPE of {group} points (m), mean over sweeps")


def _picture(title: str, numbers: pd.DataFrame, families: _Families) -> bytes:
    curve_of = {
        name: own.set_index("since_start")["dynamic_epe_m"]
        for name, own in numbers.groupby("variant")
    }
    drawn = {
        family: {name: curve_of[name] for name in own if name in curve_of}
        for family, own in families.items()
    }
    return curves(title, drawn, "sweep since the start", "EPE of dynamic points (m)")


def _part_text(first: int, last: float) -> str:
    return f"{first} to {last:g}" if math.isfinite(last) else f"from {first} on"
