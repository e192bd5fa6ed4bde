# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Rows as one table, and its summary with one line for each method.

Columns are named like the fields of a row in `rows.jsonl`, nested ones with dots between:
`time_ms`, `errors.dynamic.epe_m`, `by_range.20.acc5`, `consistency.nearest_m`. A summary has their
means over the examples with a flow, each example counting the same, NaN where no example has a
value; numbers of points are sums. It adds

* `num_examples`, `num_failed`, `num_dropped`, `num_lost` (ego motion lost), `num_warm` (warm
  starts) and `num_out_of_time` (optimizations ended by their time budget);
* `three_way.GROUP`, `bucketed.CLASS.dynamic` or `.static`, and `range_wise.NAME`, see
  `argoverse_metrics`;
* `movers.FIGURE`, see `_summarize_movers`.
"""

import math
from collections.abc import Iterable, Sequence
from dataclasses import asdict, fields, replace
from typing import Final

import numpy as np
import pandas as pd

from mnsf_ros.evaluation.argoverse_metrics import over_all_points
from mnsf_ros.evaluation.metrics import mean
from mnsf_ros.evaluation.movers import STOPPED_M_S, MoverRow, ObjectRow
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.sweeps.sweep import NANOSECONDS

_OUT_OF_TIME: Final = "time_budget"
_NUM_POINTS: Final = ".num_points"
# An object that was away for longer comes into view anew.
_MAX_AWAY_S: Final = 0.5
_TINY_S: Final = 1e-3

FAST: Final = "2 m/s and faster, to 50 m"
SLOW: Final = "0.5 to 2 m/s, to 30 m"
_ANY: Final = "speed_m_s >= 0.5 and range_m <= 50"
# Movers that are scored together: name in tables to condition, see `ObjectRow`. The first two have
# targets.
MOVER_GROUPS: Final = {
    FAST: "speed_m_s >= 2 and range_m <= 50",
    SLOW: "0.5 <= speed_m_s < 2 and range_m <= 30",
    "2 to 5 m/s, to 50 m": "2 <= speed_m_s < 5 and range_m <= 50",
    "5 to 10 m/s, to 50 m": "5 <= speed_m_s < 10 and range_m <= 50",
    "10 m/s and faster, to 50 m": "speed_m_s >= 10 and range_m <= 50",
    "cars, to 50 m": f"{_ANY} and kind == 'car'",
    "large vehicles, to 50 m": f"{_ANY} and kind == 'large vehicle'",
    "two-wheelers, to 50 m": f"{_ANY} and kind == 'cyclist'",
    "pedestrians, to 30 m": f"{_ANY} and range_m <= 30 and kind == 'pedestrian'",
}
# Grace period after an object comes into view, longer for slow ones.
_FIRST_S: Final = {SLOW: 0.6, "pedestrians, to 30 m": 0.6}
_USUAL_FIRST_S: Final = 0.3
_COLUMNS: Final = [*(one.name for one in fields(ObjectRow)), "recording", "time_s", "is_found"]
_TYPES: Final = {"moves": bool, "is_found": bool, "time_s": float} | dict.fromkeys(
    ("speed_m_s", "range_m", "velocity_error_m_s", "direction_error_rad"), float
)


def row_table(rows: Iterable[ResultRow]) -> pd.DataFrame:
    """Returns a table with one line for each row; the column `row` has the row itself."""
    rows = list(rows)
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
        "num_lost": sum(bool(row.lost) for row in good),
        "num_warm": sum(row.start == "warm" for row in good),
        "num_out_of_time": stop_reasons.count(_OUT_OF_TIME),
        **over_all_points(row.sums for row in good),
        **{f"movers.{name}": value for name, value in _summarize_movers(good).items()},
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


def _summarize_movers(rows: Iterable[ResultRow]) -> dict[str, float]:
    """Returns the scores over the rows of one method, in any order; empty without movers.

    NaN: not applicable.

    Returns:
        * `precision`, `recall`, `iou` of the points called dynamic;
        * `ghosts_per_sweep`, mean number of false movers, and `ghost_sweeps`, share of sweeps with
          one;
        * `velocity_error_m_s` and `direction_error_deg`, medians over tracked objects and sweeps;
        * `after_stop_s`, longest time that an object was called a mover after it had stopped; NaN
          if nothing stopped in view;
        * for each of `MOVER_GROUPS` with movers, `NAME.num_movers` (counted each time they come
          into view), `NAME.num_sweeps` (mover-sweeps after the grace period), `NAME.found` (share
          of these with detection), `NAME.flicker` (share of all mover-sweeps without detection
          between others with it), `NAME.delay_s` (mean time from coming into view until found, or
          until out of view);
        * `lost.STAGE`, number of mover-sweeps of 0.5 m/s and more up to 50 m without detection.
    """
    scored = _scored(rows)
    if not scored:
        return {}
    right, wrong, missed = np.sum([movers.points for _, movers in scored], axis=0).tolist()
    ghosts = np.array([movers.num_ghosts for _, movers in scored])
    objects = _objects(scored)
    moving = objects[objects["moves"]]
    found = {
        "precision": _share(right, right + wrong),
        "recall": _share(right, right + missed),
        "iou": _share(right, right + wrong + missed),
        "ghosts_per_sweep": float(ghosts.mean()),
        "ghost_sweeps": float((ghosts > 0).mean()),
        "velocity_error_m_s": moving["velocity_error_m_s"].median(),
        "direction_error_deg": math.degrees(moving["direction_error_rad"].median()),
        "after_stop_s": _after_stop_s(objects),
    }
    for name, condition in MOVER_GROUPS.items():
        figures = _group_figures(moving.query(condition), _FIRST_S.get(name, _USUAL_FIRST_S))
        found |= {f"{name}.{key}": value for key, value in figures.items()}
    lost = moving.query(_ANY)["lost_by"].dropna().value_counts()
    found |= {f"lost.{stage.value}": number for stage, number in lost.items()}
    return found


def missed_movers(rows: Iterable[ResultRow]) -> pd.DataFrame:
    """Returns a line for each sweep in which a method did not find a mover.

    The columns are the fields of `ObjectRow`, `recording`, `time_s`, and `is_counted`: whether
    `found` of the groups `FAST` and `SLOW` counts it.
    """
    objects = _objects(_scored(rows))
    moving = objects[objects["moves"]]
    counted = [
        _after_grace(moving.query(MOVER_GROUPS[name]), _FIRST_S.get(name, _USUAL_FIRST_S)).index
        for name in (FAST, SLOW)
    ]
    moving = moving.assign(is_counted=moving.index.isin(np.concatenate(counted)))
    return moving[~moving["is_found"]]


def _scored(rows: Iterable[ResultRow]) -> list[tuple[ResultRow, MoverRow]]:
    """The rows with movers, in their order in time."""
    rows = sorted(rows, key=lambda row: (row.recording, row.stamp_ns))
    return [(row, row.movers) for row in rows if row.movers is not None]


def _after_grace(own: pd.DataFrame, first_s: float) -> pd.DataFrame:
    """Returns the lines of movers that have been in view for `first_s`."""
    begin_s = own.groupby("view")["time_s"].transform("min")
    return own[own["time_s"] - begin_s >= first_s - _TINY_S]


def _objects(scored: Sequence[tuple[ResultRow, MoverRow]]) -> pd.DataFrame:
    """A line for each object and sweep; `view` numbers the times that objects come into view."""
    lines = []
    for row, movers in scored:
        standing = (ObjectRow(number, "", False, 0.0, 0.0, 0, 0.0) for number in movers.standing)
        for item in (*movers.objects, *standing):
            time_s = row.stamp_ns / NANOSECONDS
            line = {"recording": row.recording, "time_s": time_s, "is_found": item.is_found}
            lines.append(vars(item) | line)
    objects = pd.DataFrame(lines, columns=_COLUMNS).astype(_TYPES)
    objects = objects.sort_values(["recording", "object_id", "time_s"])
    away_s = objects.groupby(["recording", "object_id"])["time_s"].diff()
    return objects.assign(view=(away_s.isna() | (away_s > _MAX_AWAY_S)).cumsum())


def _group_figures(own: pd.DataFrame, first_s: float) -> dict[str, float]:
    """Scores of movers after a grace period; empty without any."""
    if own.empty:
        return {}
    times_s = own.groupby("view")["time_s"].agg(["min", "max"])
    hits_s = own[own["is_found"]].groupby("view")["time_s"].agg(["min", "max"])
    hits_s = hits_s.reindex(times_s.index)
    late = _after_grace(own, first_s)
    between = own["time_s"].between(own["view"].map(hits_s["min"]), own["view"].map(hits_s["max"]))
    return {
        "num_movers": len(times_s),
        "num_sweeps": len(late),
        "found": late["is_found"].mean(),
        "flicker": (between & ~own["is_found"]).mean(),
        "delay_s": (hits_s["min"].fillna(times_s["max"]) - times_s["min"]).mean(),
    }


def _after_stop_s(objects: pd.DataFrame) -> float:
    """Longest time that an object is called a mover after it stopped; NaN if none did."""
    moves = objects["moves"].astype(int)
    stops = moves.groupby(objects["view"]).cumsum()
    stopped = objects[(stops > 0) & (moves == 0) & (objects["speed_m_s"] < STOPPED_M_S)]
    starts_s = stopped.groupby([stopped["view"], stops])["time_s"].transform("min")
    return float((stopped["time_s"] - starts_s).where(stopped["is_found"], 0.0).max())


def _share(part: float, whole: float) -> float:
    return part / whole if whole else math.nan
