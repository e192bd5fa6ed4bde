"""Which method and which examples the report shows in pictures."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence

from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.run_record import RunRecord

_PREFERRED = "mnsf"


def badness(row: ResultRow) -> float:
    """Returns how bad a flow is: its error, or without truth the distance it leaves; metres."""
    errors = row.errors.get("all")
    if errors is not None and errors.num_points > 0:
        return errors.epe_m
    return row.consistency.get("nearest_m", math.nan)


def worst_rows(rows: Iterable[ResultRow], method: str) -> list[ResultRow]:
    """Returns the rows of a method that have a flow, the worst one first."""
    own = [row for row in rows if row.method == method and not row.failure]
    known = [row for row in own if not math.isnan(badness(row))]
    return sorted(known, key=lambda row: (-badness(row), row.recording, row.number))


def focus_method(rows: Sequence[ResultRow], record: RunRecord) -> str:
    """Returns the method whose worst examples are shown: the paper's, else the first real one."""
    methods = record.method_names
    found = {row.method for row in rows if not row.failure}
    order = [method for method in methods if method in found] + sorted(found - set(methods))
    if _PREFERRED in found:
        return _PREFERRED
    rivals = [method for method in order if method not in record.references]
    return next(iter(rivals or order), "")
