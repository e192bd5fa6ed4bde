# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Whether one method is better than another on the same sweeps, and how sure that is."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.results import MethodSummary, ResultRow, summarize

# Recording and number of a sweep.
SweepKey = tuple[str, int]

_GROUPS: Final = ("all", "dynamic", "static")
CONFIDENCE: Final = 0.95
# Sweeps that follow each other are alike: so many are drawn together, about a second of them.
_LONGEST_BLOCK: Final = 10
_MIN_BLOCKS: Final = 8
_NUM_DRAWS: Final = 2000


@dataclass(frozen=True)
class PairedDifference:
    """The mean error of another method minus that of the method under test, metres.

    Attributes:
        num_sweeps: Sweeps that both answered.
        under_test_m: Mean error of the method under test over these.
        other_m: Mean error of the other one.
        low_m: Lower end of the interval of the mean difference; NaN with too few sweeps.
        high_m: Its upper end.
    """

    num_sweeps: int
    under_test_m: float
    other_m: float
    low_m: float
    high_m: float

    @property
    def mean_m(self) -> float:
        """The mean difference; above 0 if the method under test is better."""
        return self.other_m - self.under_test_m

    @property
    def verdict(self) -> str:
        """Whether the method under test is better; undecided if the interval has 0 in it."""
        if self.low_m > 0:
            return "better"
        return "worse" if self.high_m < 0 else "undecided"


@dataclass(frozen=True)
class CommonSweeps:
    """The errors of all methods on the sweeps that each of them answered.

    Attributes:
        num_common: Number of these.
        num_sweeps: Number of all sweeps.
        errors: Method to its errors of all points.
    """

    num_common: int
    num_sweeps: int
    errors: dict[str, FlowErrors]


def errors_of(rows: Iterable[ResultRow], method: str, group: str) -> dict[SweepKey, float]:
    """Returns the end point error of a method on a group of points, for each sweep that has one."""
    return {
        row.sweep: row.errors[group].epe_m
        for row in rows
        if row.method == method and group in row.errors and row.errors[group].num_points > 0
    }


def common_sweeps(
    rows: Sequence[ResultRow], summaries: Iterable[MethodSummary]
) -> CommonSweeps | None:
    """Compares methods that gave any flow on the sweeps that each of them answered.

    None if all of them answered the same ones, or without truth.
    """
    answered: dict[str, set[SweepKey]] = {s.method: set() for s in summaries if s.num_examples}
    for row in rows:
        if row.failure is None:
            answered[row.method].add(row.sweep)
    common = set.intersection(*answered.values()) if answered else set()
    if all(sweeps == common for sweeps in answered.values()):
        return None
    found = summarize((row for row in rows if row.sweep in common), list(answered))
    errors = {one.method: one.errors["all"] for one in found if one.errors}
    if common and not errors:
        return None
    return CommonSweeps(len(common), len({row.sweep for row in rows}), errors)


def differences(
    rows: Sequence[ResultRow], under_test: str, methods: Iterable[str]
) -> dict[tuple[str, str], PairedDifference]:
    """Compares the method under test with others; returns method and group of points to it."""
    own = {group: errors_of(rows, under_test, group) for group in _GROUPS}
    found = {
        (method, group): paired_difference(own[group], errors_of(rows, method, group))
        for method in methods
        if method != under_test
        for group in _GROUPS
    }
    return {key: one for key, one in found.items() if one is not None}


def paired_difference(
    under_test: Mapping[SweepKey, float], other: Mapping[SweepKey, float]
) -> PairedDifference | None:
    """Compares two methods on the sweeps that both have; None if there are none.

    The interval is a bootstrap over blocks of consecutive sweeps, because these are alike. It says
    what other sweeps of these recordings would give, and nothing of other recordings.
    """
    both = sorted(under_test.keys() & other.keys())
    if not both:
        return None
    errors = np.array([(under_test[key], other[key]) for key in both])
    low_m, high_m = _interval(errors[:, 1] - errors[:, 0], [key[0] for key in both])
    under_test_m, other_m = errors.mean(axis=0).tolist()
    return PairedDifference(len(both), under_test_m, other_m, low_m, high_m)


def _interval(differences: NDArray[np.float64], recordings: Sequence[str]) -> tuple[float, float]:
    # Here, because nothing else of the evaluation needs it.
    from scipy.stats import bootstrap

    blocks = _blocks(differences, recordings)
    sums = np.array([block.sum() for block in blocks])
    counts = np.array([float(len(block)) for block in blocks])
    if len(blocks) < 2:
        return math.nan, math.nan
    if np.ptp(sums / counts) == 0:
        return float(differences.mean()), float(differences.mean())

    def mean(sums: Any, counts: Any, axis: int = -1) -> Any:  # noqa: ANN401 - as SciPy calls it
        return sums.sum(axis=axis) / counts.sum(axis=axis)

    found = bootstrap(
        (sums, counts),
        mean,
        paired=True,
        vectorized=True,
        n_resamples=_NUM_DRAWS,
        confidence_level=CONFIDENCE,
        method="percentile",
        random_state=np.random.default_rng(0),
    ).confidence_interval
    return float(found.low), float(found.high)


def _blocks(
    differences: NDArray[np.float64], recordings: Sequence[str]
) -> list[NDArray[np.float64]]:
    """Consecutive sweeps of one recording each, as long as there are enough blocks."""
    length = min(_LONGEST_BLOCK, max(1, len(differences) // _MIN_BLOCKS))
    names = np.array(recordings)
    parts = (differences[names == name] for name in dict.fromkeys(recordings))
    return [
        block for part in parts for block in np.array_split(part, max(1, round(len(part) / length)))
    ]
