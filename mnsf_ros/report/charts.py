# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of a run: errors of its sweeps, and run times."""

from __future__ import annotations

import math
from typing import Final

import pandas as pd
from markupsafe import Markup

from mnsf_ros.drawing.charts import curve_chart, stage_bars
from mnsf_ros.evaluation.summary import errors_by_sweep, part_of
from mnsf_ros.report.run_results import RunResults

_REST: Final = "other"
# A smaller part of the time outside of all stages is not worth a colour.
_REST_SHARE: Final = 0.02


def error_chart(results: RunResults) -> Markup:
    """Draws the errors of sweeps, references only among themselves; empty with fewer than two."""
    errors_m = errors_by_sweep(results.table, "all")
    scored = [name for name in results.summary.index if name in errors_m]
    shown = [name for name in scored if name not in results.record.references] or scored
    errors_m = errors_m.reindex(columns=shown).dropna(how="all")
    if len(errors_m) < 2:
        return Markup()
    places = errors_m.index.get_level_values("number").tolist()
    across = "number of the sweep, as in the tables"
    if (num_recordings := errors_m.index.get_level_values("recording").nunique()) > 1:
        places = list(range(1, len(errors_m) + 1))
        across = f"scored sweeps, counted from 1, {num_recordings} recordings in a row"
    return Markup(curve_chart("Error of each sweep", across, places, errors_m.to_dict("list")))


def time_chart(results: RunResults) -> Markup:
    """Draws the time of each stage; empty if nothing was timed."""
    times_ms = stage_times_ms(results.table)
    return Markup(stage_bars(times_ms) if times_ms else "")


def stage_times_ms(table: pd.DataFrame) -> dict[str, dict[str, float]]:
    """Returns method to stage to mean wall time in milliseconds; `other` is outside of all stages.

    `table` is a `summary.row_table`. Methods without times are missing.
    """
    timed = table.loc[[row.failure is None and row.time_ms >= 0 for row in table["row"]]]
    found: dict[str, dict[str, float]] = {}
    for method, own in timed.groupby("method", sort=False):
        times_ms = part_of(own, "stage_times_ms").fillna(0.0).mean().to_dict()
        whole_ms = own["time_ms"].mean()
        rest_ms = whole_ms - math.fsum(times_ms.values())
        found[str(method)] = times_ms | (
            {_REST: rest_ms} if rest_ms > _REST_SHARE * whole_ms else {}
        )
    return found
