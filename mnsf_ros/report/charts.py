# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of a run: errors of its sweeps and points, and run times."""

from __future__ import annotations

import math
from typing import Final, NamedTuple

import numpy as np
import pandas as pd
from markupsafe import Markup

from mnsf_ros.drawing.charts import curve_chart, share_bars, stage_bars
from mnsf_ros.evaluation.comparison import errors_by_sweep
from mnsf_ros.evaluation.metrics import ERROR_LIMITS_M
from mnsf_ros.evaluation.summary import errors_in, part_of
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import bin_names

_REST: Final = "other"
# A smaller part of the time outside of all stages is not worth a colour.
_REST_SHARE: Final = 0.02


class Charts(NamedTuple):
    """The charts of a run.

    Attributes:
        errors: Title to chart of the errors of sweeps, and of points; none without truth.
        times: The time of each stage; empty if nothing was timed.
    """

    errors: dict[str, Markup]
    times: Markup


def charts_of(results: RunResults) -> Charts:
    """Draws the charts of a run; references are in those of errors only among themselves."""
    scored = errors_in(results.summary, "all").reindex(columns=["epe_m"]).dropna().index
    shown = [name for name in scored if name not in results.record.references] or list(scored)
    times_ms = stage_times_ms(results.table)
    return Charts(
        errors=_curves(results, shown) | _shares(results, shown),
        times=Markup(stage_bars(times_ms) if times_ms else ""),
    )


def _curves(results: RunResults, shown: list[str]) -> dict[str, Markup]:
    errors_m = errors_by_sweep(results.table, "all").reindex(columns=shown).dropna(how="all")
    if len(errors_m) < 2:
        return {}
    title = "Error of each sweep"
    recordings = errors_m.index.unique("recording")
    if len(recordings) == 1:
        places = errors_m.index.get_level_values("number").tolist()
        across = "number of the sweep, as in the tables"
    else:
        places = list(range(1, len(errors_m) + 1))
        across = f"scored sweeps, counted from 1, {len(recordings)} recordings in a row"
    curves = {name: errors_m[name].tolist() for name in shown}
    return {title: Markup(curve_chart(title, across, places, curves))}


def _shares(results: RunResults, shown: list[str]) -> dict[str, Markup]:
    shares: dict[str, list[float]] = {}
    for method in shown:
        own = results.table.loc[results.table["method"] == method, "row"]
        counts = np.sum([row.error_counts for row in own if row.error_counts], axis=0)
        if np.any(counts):
            shares[method] = (counts / counts.sum()).tolist()
    if not shares:
        return {}
    title = "Share of points in bins of error"
    bins = bin_names([f"{limit:g}" for limit in ERROR_LIMITS_M])
    return {title: Markup(share_bars(title, "bin of end point error (m)", bins, shares))}


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
