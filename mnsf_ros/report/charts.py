# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The charts of a run: errors by range and speed, over the sweeps and the points, and run times."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

from markupsafe import Markup

from mnsf_ros.drawing.charts import band_chart, curve_chart, share_bars, stage_bars
from mnsf_ros.evaluation.metrics import ERROR_LIMITS_M, FlowErrors
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import bin_names

# A reference so much worse than the best method would flatten all other lines of a chart.
_OFF_THE_CHART: Final = 5.0


class Charts(NamedTuple):
    """The charts of a run, each with its title.

    Attributes:
        wide: Errors of the sweeps, and shares of points; none without truth.
        bins: Errors in bins of range and of speed; none without truth.
        times: The time of each stage; empty if nothing was timed.
        not_drawn: Which references the charts of errors leave out, and why; empty if none.
    """

    wide: dict[str, Markup]
    bins: dict[str, Markup]
    times: Markup
    not_drawn: str


def charts_of(results: RunResults) -> Charts:
    """Draws the charts of a run."""
    # One that failed everywhere has no line.
    scored = [s for s in results.summaries if s.errors and s.errors["all"].num_points]
    shown = _on_the_chart(scored, results.record.references)
    left_out = ", ".join(one.method for one in scored if one not in shown)
    reason = f"an error more than {_OFF_THE_CHART:g} times that of the best method"
    times_ms = {k: one.stage_times_ms for k, one in results.sweeps.items() if one.stage_times_ms}
    return Charts(
        wide=_curves(results, shown) | _shares(results, shown),
        bins=_bins(
            "Error in bins of range",
            "bin of distance from the sensor (m)",
            {one.method: one.by_range for one in shown},
        )
        | _bins(
            "Error in bins of speed",
            "bin of true speed without ego motion (m/s)",
            {one.method: one.by_speed for one in shown},
        ),
        times=Markup(stage_bars(times_ms) if times_ms else ""),
        not_drawn=f"Not in these charts: {left_out}, with {reason}." if left_out else "",
    )


def _on_the_chart(
    scored: Sequence[MethodSummary], references: frozenset[str]
) -> list[MethodSummary]:
    rivals_m = [s.errors["all"].epe_m for s in scored if s.method not in references]
    best_m, worst_m = min(rivals_m, default=0), max(rivals_m, default=0)
    limit_m = max(_OFF_THE_CHART * best_m, worst_m) or math.inf
    return [s for s in scored if s.method not in references or s.errors["all"].epe_m <= limit_m]


def _bins(
    title: str, across: str, bins: Mapping[str, Mapping[str, FlowErrors]]
) -> dict[str, Markup]:
    limits = sorted({limit for errors in bins.values() for limit in errors}, key=float)
    values = {
        method: [errors[x].epe_m if x in errors else math.nan for x in limits]
        for method, errors in bins.items()
    }
    if not limits:
        return {}
    return {title: Markup(band_chart(title, across, bin_names(limits), values))}


def _curves(results: RunResults, shown: Sequence[MethodSummary]) -> dict[str, Markup]:
    errors = {one.method: results.sweeps[one.method].errors_m for one in shown}
    sweeps = sorted({key for known in errors.values() for key in known})
    if len(sweeps) < 2:
        return {}
    title = "Error of each sweep"
    curves = {name: [known.get(key, math.nan) for key in sweeps] for name, known in errors.items()}
    num_recordings = len({recording for recording, _ in sweeps})
    if num_recordings == 1:
        places, across = [number for _, number in sweeps], "number of the sweep, as in the tables"
    else:
        places = list(range(1, len(sweeps) + 1))
        across = f"scored sweeps, counted from 1, {num_recordings} recordings in a row"
    return {title: Markup(curve_chart(title, across, places, curves))}


def _shares(results: RunResults, shown: Sequence[MethodSummary]) -> dict[str, Markup]:
    known = {one.method: results.sweeps[one.method].error_shares for one in shown}
    shares = {method: own for method, own in known.items() if own}
    if not shares:
        return {}
    title = "Share of points in bins of error"
    bins = bin_names([f"{limit:g}" for limit in ERROR_LIMITS_M])
    return {title: Markup(share_bars(title, "bin of end point error (m)", bins, shares))}
