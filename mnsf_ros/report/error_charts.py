"""The charts of errors: over bins of range and speed, over the sweeps, and how many points."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from markupsafe import Markup

from mnsf_ros.drawing.charts import band_chart, curve_chart, share_bars
from mnsf_ros.evaluation.metrics import ERROR_LIMITS_M
from mnsf_ros.evaluation.paired import errors_of
from mnsf_ros.evaluation.results import MethodSummary, ResultRow
from mnsf_ros.report.tables import bin_names

# A reference so much worse than the best method would flatten all other lines of a chart.
_OFF_THE_CHART: Final = 5.0

Chart = tuple[str, Markup]


def bin_charts(summaries: Sequence[MethodSummary], references: frozenset[str]) -> list[Chart]:
    """Returns title and chart of the error in bins of range and of speed; none without truth."""
    # One that failed everywhere has no line.
    scored = [s for s in summaries if s.by_range or s.by_speed]
    shown = _on_the_chart(scored, references)
    charts = []
    for title, across, bins in (
        (
            "Error in bins of range",
            "bin of distance from the sensor (m)",
            {s.method: s.by_range for s in shown},
        ),
        (
            "Error in bins of speed",
            "bin of true speed without ego motion (m/s)",
            {s.method: s.by_speed for s in shown},
        ),
    ):
        limits = sorted({limit for errors in bins.values() for limit in errors}, key=float)
        values = {
            method: [errors[x].epe_m if x in errors else math.nan for x in limits]
            for method, errors in bins.items()
        }
        if limits:
            charts.append((title, Markup(band_chart(title, across, bin_names(limits), values))))
    return charts


def point_charts(
    rows: Sequence[ResultRow], summaries: Sequence[MethodSummary], references: frozenset[str]
) -> list[Chart]:
    """Returns the error of each sweep, and how many points have which error; none without truth."""
    scored = [s for s in summaries if s.errors and s.errors["all"].num_points]
    methods = [one.method for one in _on_the_chart(scored, references)]
    charts = []
    errors = {method: errors_of(rows, method, "all") for method in methods}
    sweeps = sorted({key for known in errors.values() for key in known})
    if len(sweeps) > 1:
        title = "Error of each sweep"
        curves = {
            name: [known.get(key, math.nan) for key in sweeps] for name, known in errors.items()
        }
        num_recordings = len({recording for recording, _ in sweeps})
        across = "sweep" if num_recordings == 1 else f"sweep, {num_recordings} recordings in a row"
        charts.append((title, Markup(curve_chart(title, across, curves))))
    shares = {method: known for method in methods if (known := _error_shares(rows, method))}
    if shares:
        title = "Share of points in bins of error"
        bins = bin_names([f"{limit:g}" for limit in ERROR_LIMITS_M])
        charts.append(
            (title, Markup(share_bars(title, "bin of end point error (m)", bins, shares)))
        )
    return charts


def methods_not_drawn(summaries: Sequence[MethodSummary], references: frozenset[str]) -> str:
    """Returns which references the charts of errors leave out, and why; empty if none."""
    scored = [s for s in summaries if s.errors and s.errors["all"].num_points]
    drawn = {one.method for one in _on_the_chart(scored, references)}
    left_out = ", ".join(one.method for one in scored if one.method not in drawn)
    reason = f"an error more than {_OFF_THE_CHART:g} times that of the best method"
    return f"Not in these charts: {left_out}, with {reason}." if left_out else ""


def _on_the_chart(
    scored: Sequence[MethodSummary], references: frozenset[str]
) -> list[MethodSummary]:
    rivals_m = [s.errors["all"].epe_m for s in scored if s.method not in references]
    best_m, worst_m = min(rivals_m, default=0), max(rivals_m, default=0)
    limit_m = max(_OFF_THE_CHART * best_m, worst_m) or math.inf
    return [s for s in scored if s.method not in references or s.errors["all"].epe_m <= limit_m]


def _error_shares(rows: Sequence[ResultRow], method: str) -> list[float]:
    """The share of all points in each bin of error; empty if nobody knows."""
    counts = [row.error_counts for row in rows if row.method == method and row.error_counts]
    totals = np.sum(counts, axis=0) if counts else np.zeros(0)
    shares: list[float] = (totals / max(1, totals.sum())).tolist()
    return shares
