# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Comparison of methods on the same sweeps, with confidence intervals."""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import product
from typing import Final

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from mnsf_ros.evaluation.summary import GROUPS, summary_of

CONFIDENCE: Final = 0.95
# Consecutive sweeps are alike: so many are drawn together, about a second of them.
_LONGEST_BLOCK: Final = 10
_MIN_BLOCKS: Final = 8
_NUM_DRAWS: Final = 2000

_SWEEP: Final = ["recording", "number"]


def errors_by_sweep(table: pd.DataFrame, group: str) -> pd.DataFrame:
    """Returns the EPE of a group of points in metres: a line for each sweep, a column a method.

    `table` is a `summary.row_table`; sweeps without any error are missing.
    """
    name = f"errors.{group}.epe_m"
    if name not in table:
        return pd.DataFrame()
    return table.dropna(subset=name).pivot(index=_SWEEP, columns="method", values=name)


def common_sweeps(table: pd.DataFrame) -> tuple[int, pd.DataFrame] | None:
    """Returns the number of sweeps that every method with any flow answered, and their summary.

    None if all methods answered the same sweeps.
    """
    answered = table.loc[[row.failure is None for row in table["row"]]]
    is_answered = answered.assign(one=1).pivot(index=_SWEEP, columns="method", values="one").notna()
    common = is_answered.index[is_answered.all(axis=1)]
    if len(common) == len(is_answered):
        return None
    own = answered.loc[answered.set_index(_SWEEP).index.isin(common)]
    return len(common), summary_of(own)


def differences(table: pd.DataFrame, under_test: str, methods: Iterable[str]) -> pd.DataFrame:
    """Compares the EPE of the method under test with that of other methods, metres.

    `table` is a `summary.row_table`.

    Returns:
        A line for each other method and group of points, on the sweeps that both answered:
        `num_sweeps`, `under_test_m`, `other_m`, their difference `mean_m` (above 0 if the method
        under test is better) and its interval from `low_m` to `high_m`, NaN with too few sweeps.
        The interval is a bootstrap over blocks of consecutive sweeps. It holds for other sweeps
        of these recordings, not for other recordings.
    """
    errors_m = {group: errors_by_sweep(table, group) for group in GROUPS}
    lines: dict[tuple[str, str], dict[str, float]] = {}
    for method, group in product(methods, GROUPS):
        both = errors_m[group].reindex(columns=[under_test, method]).dropna()
        if method != under_test and len(both):
            lines[method, group] = _difference(both)
    return pd.DataFrame.from_dict(lines, orient="index")


def _difference(errors_m: pd.DataFrame) -> dict[str, float]:
    """Compares two columns: the method under test, and another one."""
    under_test, other = (errors_m.iloc[:, place] for place in (0, 1))
    low_m, high_m = _interval(other - under_test)
    return {
        "num_sweeps": len(errors_m),
        "under_test_m": under_test.mean(),
        "other_m": other.mean(),
        "mean_m": other.mean() - under_test.mean(),
        "low_m": low_m,
        "high_m": high_m,
    }


def verdict(difference: pd.Series) -> str:
    """Returns whether the method under test is better; undecided if 0 is in the interval."""
    if difference["low_m"] > 0:
        return "better"
    return "worse" if difference["high_m"] < 0 else "undecided"


def _interval(differences_m: pd.Series) -> tuple[float, float]:
    """Interval of the mean: percentiles over draws of as many blocks as there are."""
    blocks = _blocks(differences_m)
    if len(blocks) < 2:
        return math.nan, math.nan
    sums = np.array([block.sum() for block in blocks])
    counts = np.array([float(len(block)) for block in blocks])
    drawn = np.random.default_rng(0).integers(len(blocks), size=(_NUM_DRAWS, len(blocks)))
    means_m = sums[drawn].sum(axis=1) / counts[drawn].sum(axis=1)
    low, high = np.quantile(means_m, [(1 - CONFIDENCE) / 2, (1 + CONFIDENCE) / 2])
    return float(low), float(high)


def _blocks(differences_m: pd.Series) -> list[NDArray[np.float64]]:
    """Consecutive sweeps of one recording each, as long as there are enough blocks."""
    length = min(_LONGEST_BLOCK, max(1, len(differences_m) // _MIN_BLOCKS))
    return [
        block
        for _, part in differences_m.groupby(level="recording")
        for block in np.array_split(part.to_numpy(), max(1, round(len(part) / length)))
    ]
