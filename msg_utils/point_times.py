# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Times of the points of a cloud, from the field of its driver."""

from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from msg_utils.cloud_layout import PointCloudLike
from msg_utils.errors import describe
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import NANOSECONDS_PER_SECOND

# Any object with `field` (a name; `none`: no times), `unit` (`s`, `ms`, `us` or `ns`) and `stamp`:
# whether the cloud's stamp is the time of the first point (`start`) or of the last one (`end`).
TimeRuleLike: TypeAlias = Any

AUTO: Final = "auto"
NO_FIELD: Final = "none"
# In the order in which they are tried. Not `time_offset`: converted data sets have it beside points
# that may be free of the motion already.
FIELD_NAMES: Final = (
    *("t", "time", "timestamp", "time_stamp", "offset_time"),
    *("time_offset_ns", "offset_time_ns"),
)
UNITS_S: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# Duration of a sweep. At most one of `s`, `us` and `ns` gives it for given numbers.
_SHORTEST_S: Final = 0.002
_LONGEST_S: Final = 2.0
# Smaller numbers are something else: a tag, a line, a temperature.
_MIN_BYTES: Final = 4
# Units of the rule `auto`, by the kind of the numbers.
_USUAL_UNITS: Final = {"f": ("s", "us", "ns"), "i": ("us", "ns"), "u": ("us", "ns")}
# A value is no time of the sweep if it is away from most others, which are all but these shares of
# the lowest and highest, by more than twice their span. A sample of the values tells.
_FEW: Final = 0.05
_MAX_AWAY: Final = 2.0
# Where the samples are in a cloud, 0 to 1: one in each part. At even steps they would be the same
# few rows of some clouds, and miss the times of all others.
_PLACES: Final = (np.arange(2000) + np.random.default_rng(0).random(2000)) / 2000
# Times farther apart, of so many points each, were rounded: lidars measure a firing, a column or a
# packet at a time, of 2 ms at most.
_COARSE_S: Final = 0.003
_MANY: Final = 10
# Flow of simulated sweeps with times in steps of 10 ms is as good as with exact ones; in steps of
# 25 ms it is worse than without.
_FEWEST: Final = 8
# Floats from 0 to about 1 are shares of the interval if that is far from 1 s. Those that span this
# share of it in milliseconds are such.
_SHARES: Final = 0.9


@dataclass(frozen=True, eq=False)
class PointTimes:
    """Times of the points of a cloud.

    Attributes:
        times_s: (N,) float32, seconds after the stamp of the cloud, negative before it; NaN for the
            few points whose values are far from all others or not finite; None if unknown.
        source: Description of field, unit and stamp, the same for similar clouds; `none`.
        fault: Fault of the times in the cloud; empty without a fault or without times.
    """

    times_s: npt.NDArray[np.float32] | None
    source: str = NO_FIELD
    fault: str = ""


class _UnfitError(ValueError):
    """The values of a field cannot be times of a sweep."""


def decode_times(
    cloud: PointCloudLike,
    wanted: npt.NDArray[np.bool_],
    stamp_ns: int,
    rule: TimeRuleLike,
    interval_s: float,
) -> PointTimes:
    """Reads the times of the wanted points (height * width,) of a cloud of this stamp.

    Unfit times are a fault of the result, not an error. `auto` of the rule is decided by type, name
    and values of the fields, and by the interval of the clouds.

    Raises:
        MessageError: The cloud cannot be decoded.
    """
    points = decode_points(cloud).reshape(-1)
    present = points.dtype.names or ()
    names = FIELD_NAMES if rule.field == AUTO else (rule.field,)
    faults = []
    if rule.field not in (AUTO, NO_FIELD, *present):
        faults.append(f"no field {describe(rule.field)}, the fields are {describe(list(present))}")
    if rule.field == NO_FIELD or not wanted.any():
        return PointTimes(None)
    for name in names:
        if name in present:
            try:
                return _times_of(name, points[name], wanted, stamp_ns, rule, interval_s)
            except _UnfitError as error:
                faults.append(f"field {describe(name)}: {error}")
    return PointTimes(None, fault="; ".join(faults))


def _times_of(
    name: str,
    column: npt.NDArray[Any],
    wanted: npt.NDArray[np.bool_],
    stamp_ns: int,
    rule: TimeRuleLike,
    interval_s: float,
) -> PointTimes:
    scalar = column.dtype
    if column.ndim > 1:
        raise _UnfitError(f"has {column.shape[1]} elements for each point, expected 1")
    if rule.field == AUTO and scalar.itemsize < _MIN_BYTES:
        raise _UnfitError(f"is of type {scalar}, expected at least {8 * _MIN_BYTES} bits")
    values = np.compress(wanted, column).astype(np.float64)
    first, last = _without_the_lost(values, scalar)
    unit, unit_s = _unit(first, last, scalar.kind, interval_s, rule)
    span_s = (last - first) * unit_s
    if not _SHORTEST_S <= span_s < _LONGEST_S:
        raise _UnfitError(
            f"values from {first:g} to {last:g} {unit} are no sweep of {_SHORTEST_S:g} to "
            f"{_LONGEST_S:g} s"
        )
    step_s = _coarse_step(values, unit_s)
    zero, meaning = _zero(first, last, stamp_ns / (NANOSECONDS_PER_SECOND * unit_s), rule)
    values -= zero
    values *= unit_s
    steps = f", in steps of {1e3 * step_s:.0f} ms" if step_s else ""
    source = f"field {describe(name)} ({scalar.name}, {unit}, {meaning}{steps})"
    return PointTimes(values.astype(np.float32), source)


def _without_the_lost(
    values: npt.NDArray[np.float64], scalar: np.dtype[Any]
) -> tuple[float, float]:
    """Makes values that are no times of the sweep NaN; returns the first and the last time."""
    low, high = _most(values)
    wrap = 2.0 ** (8 * scalar.itemsize)
    if scalar.kind == "u" and values.max() - low > wrap / 2:
        # Numbers below 0 have become the largest ones.
        values -= wrap * np.round((values - low) / wrap)
        low, high = _most(values)
    away = _MAX_AWAY * (high - low)
    earliest, latest = low - away, high + away
    if not (earliest <= values.min() and values.max() <= latest):  # or NaN
        is_lost = ~((values >= earliest) & (values <= latest))
        if (num_lost := int(np.count_nonzero(is_lost))) > 2 * _FEW * len(values):
            raise _UnfitError(f"{num_lost:,} values are not finite or far from the others")
        values[is_lost] = np.nan
        return float(np.nanmin(values)), float(np.nanmax(values))
    return float(values.min()), float(values.max())


def _coarse_step(values: npt.NDArray[np.float64], unit_s: float) -> float:
    """Returns the mean step between times that were rounded, in seconds; 0 if they were not."""
    sample = _some(values)
    shared = np.unique(sample[np.isfinite(sample)])
    step_s = float(shared[-1] - shared[0]) * unit_s / max(len(shared) - 1, 1)
    if step_s < _COARSE_S or len(shared) * _MANY > len(sample):
        return 0.0
    if len(shared) < _FEWEST:
        raise _UnfitError(f"only {len(shared)} values: rounded, as by lossy compression")
    return step_s


def _some(values: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
    """Returns values from all over the cloud; all of them if they are few."""
    if len(values) <= len(_PLACES):
        return values
    return values[(_PLACES * len(values)).astype(np.int64)]


def _most(values: npt.NDArray[np.float64]) -> tuple[float, float]:
    """Returns the lowest and highest value without a few of each."""
    sample = _some(values)
    sample = np.sort(sample[np.isfinite(sample)])
    if not len(sample):
        raise _UnfitError("no value is finite")
    few = int(_FEW * len(sample))
    return float(sample[few]), float(sample[-1 - few])


def _unit(
    first: float, last: float, kind: str, interval_s: float, rule: TimeRuleLike
) -> tuple[str, float]:
    """Returns the unit in which the values span a sweep, and its seconds."""
    if rule.unit != AUTO:
        return rule.unit, UNITS_S[rule.unit]
    if first == last:
        raise _UnfitError(f"all values are {first:g}")
    span = last - first
    if kind == "f" and first >= 0 and last <= 1 and span >= max(_SHARES, 2 * interval_s):
        return "shares of the interval", interval_s
    for unit in _USUAL_UNITS[kind]:
        if _SHORTEST_S <= span * UNITS_S[unit] < _LONGEST_S:
            return unit, UNITS_S[unit]
    if _SHARES * interval_s <= span * UNITS_S["ms"] <= interval_s / _SHARES:
        return "ms", UNITS_S["ms"]
    units = ", ".join(_USUAL_UNITS[kind])
    raise _UnfitError(f"values from {first:g} to {last:g} span no sweep in any of {units}")


def _zero(first: float, last: float, stamp: float, rule: TimeRuleLike) -> tuple[float, str]:
    """Returns the value at the time of the stamp, and the meaning of the values."""
    if rule.stamp == "start":
        return first, "stamp at the start"
    if rule.stamp == "end":
        return last, "stamp at the end"
    # The stamp may be up to a sweep before the first or after the last point: drivers that take
    # the time of reception. Farther off it is of another clock.
    span = last - first
    for zero, meaning in ((0.0, "relative to the stamp"), (stamp, "absolute")):
        if first - span <= zero <= last + span:
            return zero, meaning
    return first, "of another clock: stamp at the start"
