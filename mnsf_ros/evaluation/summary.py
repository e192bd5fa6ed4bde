# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rows as one table, and its summary with one line for each method.

Columns are named like the fields of a row in `rows.jsonl`, nested ones with dots between:
`time_ms`, `errors.dynamic.epe_m`, `by_range.20.acc5`, `consistency.nearest_m`. A summary has their
means over the examples with a flow, each example counting the same, NaN where no example has a
value; numbers of points are sums. It adds

* `num_examples`, `num_failed`, `num_dropped`, `num_warm` (warm starts) and `num_out_of_time`
  (optimizations ended by their time budget);
* `three_way.GROUP` and `bucketed.CLASS.dynamic` or `.static`, see `argoverse_metrics`;
* `movers.FIGURE`, see `mover_summary`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields, replace
from typing import Final

import pandas as pd

from mnsf_ros.evaluation.argoverse_metrics import over_all_points
from mnsf_ros.evaluation.metrics import mean
from mnsf_ros.evaluation.mover_summary import summarize_movers
from mnsf_ros.evaluation.results import ResultRow

_OUT_OF_TIME: Final = "time_budget"
_NUM_POINTS: Final = ".num_points"


def row_table(rows: Iterable[ResultRow]) -> pd.DataFrame:
    """Returns a table with one line for each row; the column `row` has the row itself."""
    rows = list(rows)
    # Objects of a sweep are no columns.
    table = pd.json_normalize([asdict(replace(row, movers=None)) for row in rows])
    if table.empty:
        table = pd.DataFrame(columns=[field.name for field in fields(ResultRow)])
    return table.assign(row=rows)


def summarize(rows: Iterable[ResultRow], methods: Sequence[str] = ()) -> pd.DataFrame:
    """Returns the summary, indexed by method: `methods` first, the others follow by name."""
    return summary_of(row_table(rows), methods)


def summary_of(table: pd.DataFrame, methods: Sequence[str] = ()) -> pd.DataFrame:
    """Returns the summary of a table of rows, see `summarize`."""
    lines = {method: list(own) for method, own in table.groupby("method")["row"]}
    order = [method for method in methods if method in lines]
    order += sorted(lines.keys() - set(order))
    good = table.loc[[row.failure is None for row in table["row"]]]
    figures = good.select_dtypes("number").drop(columns="number", errors="ignore")
    grouped = figures.groupby(good["method"])
    # The order of the rows must not change the last digit.
    means = grouped.agg(mean)
    counts = [name for name in means if name.endswith(_NUM_POINTS)]
    means[counts] = grouped[counts].sum(min_count=1)
    further = {method: _further(lines[method]) for method in order}
    return pd.DataFrame.from_dict(further, orient="index").join(means).rename_axis("method")


def _further(rows: Sequence[ResultRow]) -> dict[str, float]:
    """Figures of one method that are no means over its examples."""
    good = [row for row in rows if row.failure is None]
    stop_reasons = [reason for row in good for reason in row.stop_reasons.values()]
    return {
        "num_examples": len(good),
        "num_failed": sum(row.has_failed for row in rows),
        "num_dropped": sum(row.is_dropped for row in rows),
        "num_warm": sum(row.start == "warm" for row in good),
        "num_out_of_time": stop_reasons.count(_OUT_OF_TIME),
        **over_all_points(row.sums for row in good),
        **{f"movers.{name}": value for name, value in summarize_movers(good).items()},
    }


def part_of(summary: pd.DataFrame, prefix: str) -> pd.DataFrame:
    """Returns the columns with values whose names begin with a prefix and a dot, without these."""
    names = [name for name in summary if name.startswith(f"{prefix}.")]
    part = summary[names].dropna(axis=1, how="all")
    return part.rename(columns=lambda name: name.removeprefix(f"{prefix}."))


def errors_in(summary: pd.DataFrame, group: str) -> pd.DataFrame:
    """Returns the errors of a group of points, `FlowErrors` by name, of methods with truth."""
    return part_of(summary, f"errors.{group}").dropna(how="all")


def groups_in(own: pd.Series, field: str) -> list[str]:
    """Returns the groups of points of a method with errors; bins in ascending order of limits."""
    counts = [name for name in own.dropna().index if name.startswith(f"{field}.")]
    names = [name.split(".", 1)[1] for name in counts if name.endswith(_NUM_POINTS)]
    names = [name.removesuffix(_NUM_POINTS) for name in names]
    return names if field == "errors" else sorted(names, key=float)
