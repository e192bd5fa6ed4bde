"""Examples with the flows that methods found for them, ready to be drawn."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.report.result_table import REFERENCES

_PREFERRED = "mnsf"


@dataclass(frozen=True, eq=False)
class PicturedFlow:
    """What one method found.

    Attributes:
        method: Its name.
        flow: (N, 3) metres per sweep; rows that are not finite have none.
        error_m: (N,) how wrong it is, see `PicturedExample.error_name`; NaN where unknown.
        is_again: Whether it was estimated again for the picture, from its sweeps alone.
    """

    method: str
    flow: NDArray[Any]
    error_m: NDArray[np.float64]
    is_again: bool = False


@dataclass(frozen=True, eq=False)
class PicturedExample:
    """One example with the flows of some methods.

    Attributes:
        recording: Name of the recording.
        number: Place of the sweep in the recording.
        stamp_ns: Stamp of the sweep.
        xyz: (N, 3) metres, the points that the methods got, sensor frame.
        truth: (N, 3) metres per sweep, NaN where unknown; None if there is none at all.
        next_from_current: (4, 4) the sensor's own motion; None if it is to be fitted.
        flows: What the methods found.
        error_name: What the errors are: the distance to the true flow, or, where there is no
            truth, that of the moved points to the next sweep.
    """

    recording: str
    number: int
    stamp_ns: int
    xyz: NDArray[np.float32]
    truth: NDArray[np.float32] | None = None
    next_from_current: NDArray[np.float64] | None = None
    flows: list[PicturedFlow] = field(default_factory=list)
    error_name: str = "end point error"

    @property
    def key(self) -> tuple[str, int]:
        """Recording and number of the sweep."""
        return self.recording, self.number


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


def focus_method(rows: Sequence[ResultRow], methods: Sequence[str]) -> str:
    """Returns the method whose worst examples are shown: the paper's, else the first real one."""
    found = {row.method for row in rows if not row.failure}
    order = [method for method in methods if method in found] + sorted(found - set(methods))
    if _PREFERRED in found:
        return _PREFERRED
    rivals = [method for method in order if method not in REFERENCES]
    return next(iter(rivals or order), "")
