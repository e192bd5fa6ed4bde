# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Comparison of methods on the same sweeps, with confidence intervals."""

from __future__ import annotations

from collections.abc import Iterable
from itertools import product
from typing import Final

import pandas as pd
from scipy.stats import t as student_t

from mnsf_ros.evaluation.summary import GROUPS, SWEEP, errors_by_sweep, summary_of

_CONFIDENCE: Final = 0.95
# Consecutive sweeps are alike: so many count as one observation, about a second of them.
_LONGEST_BLOCK: Final = 10
_MIN_BLOCKS: Final = 8


def common_sweeps(table: pd.DataFrame) -> tuple[int, pd.DataFrame] | None:
    """Returns the number of sweeps that every method with any flow answered, and their summary.

    None if all methods answered the same sweeps.
    """
    answered = table.loc[[row.failure is None for row in table["row"]]]
    num_methods = answered.groupby(SWEEP)["method"].transform("nunique")
    common = answered[num_methods == answered["method"].nunique()]
    if len(common) == len(answered):
        return None
    return len(common.drop_duplicates(SWEEP)), summary_of(common)


def differences(table: pd.DataFrame, under_test: str, methods: Iterable[str]) -> pd.DataFrame:
    """Compares the EPE of the method under test with that of other methods, metres.

    `table` is a `summary.row_table`.

    Returns:
        A line for each other method and group of points, on the sweeps that both answered:
        `num_sweeps`, `under_test_m`, `other_m`, their difference `mean_m` (above 0 if the method
        under test is better) and its interval from `low_m` to `high_m`, NaN with too few sweeps.
        The interval is Student's, of the means of blocks of consecutive sweeps. It holds for other
        sweeps of these recordings, not for other recordings.
    """
    errors_m = {group: errors_by_sweep(table, group) for group in GROUPS}
    lines: dict[tuple[str, str], dict[str, float]] = {}
    for method, group in product(methods, GROUPS):
        both = errors_m[group].reindex(columns=[under_test, method]).dropna()
        if method != under_test and len(both):
            gain_m = both[method] - both[under_test]
            half_m = _half_interval(gain_m)
            lines[method, group] = {
                "num_sweeps": len(both),
                "under_test_m": both[under_test].mean(),
                "other_m": both[method].mean(),
                "mean_m": gain_m.mean(),
                "low_m": gain_m.mean() - half_m,
                "high_m": gain_m.mean() + half_m,
            }
    return pd.DataFrame.from_dict(lines, orient="index")


def verdict(difference: pd.Series) -> str:
    """Returns whether the method under test is better; undecided if 0 is in the interval."""
    if difference["low_m"] > 0:
        return "better"
    return "worse" if difference["high_m"] < 0 else "undecided"


def _half_interval(differences_m: pd.Series) -> float:
    """Half the width of the interval of the mean; NaN with fewer than two blocks."""
    length = min(_LONGEST_BLOCK, max(1, len(differences_m) // _MIN_BLOCKS))
    place = differences_m.groupby(level="recording").cumcount() // length
    means_m = differences_m.groupby(["recording", place]).mean()
    return float(student_t.ppf((1 + _CONFIDENCE) / 2, len(means_m) - 1) * means_m.sem())
