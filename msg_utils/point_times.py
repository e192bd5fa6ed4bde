# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""When each point of a cloud was measured, from the field in which its driver says so."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from msg_utils.cloud_layout import PointCloudLike
from msg_utils.errors import describe
from msg_utils.point_cloud2 import decode_points
from msg_utils.stamps import NANOSECONDS_PER_SECOND

AUTO: Final = "auto"
NO_FIELD: Final = "none"
# In the order in which they are tried.
FIELD_NAMES: Final = ("t", "time", "timestamp", "time_stamp", "offset_time")
UNITS_S: Final = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
# A sweep takes from here to there. Of `s`, `us` and `ns` one at most makes that of given numbers.
_SHORTEST_S: Final = 0.002
_LONGEST_S: Final = 2.0
# Numbers of fewer bits are something else: a tag, a line, a temperature.
_MIN_BYTES: Final = 4
# Units that are tried by themselves, by the kind of the numbers.
_USUAL_UNITS: Final = {"f": ("s", "us", "ns"), "i": ("us", "ns"), "u": ("us", "ns")}


@dataclass(frozen=True)
class TimeRule:
    """How times are to be read; `auto` leaves it to type, name and values of the fields.

    Attributes:
        field: Name of the field; `none`: do not read any.
        unit: `s`, `ms`, `us` or `ns`.
        stamp: What the stamp of the cloud is: `start`, the time of the first point, or `end`, that
            of the last one.
    """

    field: str = AUTO
    unit: str = AUTO
    stamp: str = AUTO


@dataclass(frozen=True, eq=False)
class PointTimes:
    """What a cloud says of the times of its points.

    Attributes:
        times_s: (N,) float32, seconds after the stamp of the cloud, negative before it; None if
            they are not known.
        source: What they were read from, the same text for all clouds that are alike; `none`.
        fault: What is wrong with the times that the cloud has; empty if nothing is, or if it has
            none.
    """

    times_s: npt.NDArray[np.float32] | None
    source: str = NO_FIELD
    fault: str = ""


class _UnfitError(ValueError):
    """The values of a field that cannot be the times of the points of a sweep."""


def decode_times(
    cloud: PointCloudLike,
    wanted: npt.NDArray[np.bool_],
    stamp_ns: int,
    rule: TimeRule = TimeRule(),
) -> PointTimes:
    """Reads the times of the wanted points (height * width,) of a cloud of this stamp.

    Never fails: times that cannot be trusted are none.

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
                return _times_of(name, points[name], wanted, stamp_ns, rule)
            except _UnfitError as error:
                faults.append(f"field {describe(name)}: {error}")
    return PointTimes(None, fault="; ".join(faults))


def _times_of(
    name: str,
    column: npt.NDArray[Any],
    wanted: npt.NDArray[np.bool_],
    stamp_ns: int,
    rule: TimeRule,
) -> PointTimes:
    scalar = column.dtype
    if column.ndim > 1:
        raise _UnfitError(f"has {column.shape[1]} elements for each point, expected 1")
    if rule.field == AUTO and scalar.itemsize < _MIN_BYTES:
        raise _UnfitError(f"is of type {scalar}, expected at least {8 * _MIN_BYTES} bits")
    values = np.compress(wanted, column).astype(np.float64)
    if not np.isfinite(values).all():
        raise _UnfitError(f"{np.count_nonzero(~np.isfinite(values)):,} values are not finite")
    first, last = float(values.min()), float(values.max())
    unit = _unit(first, last, scalar.kind) if rule.unit == AUTO else rule.unit
    span_s = (last - first) * UNITS_S[unit]
    if not _SHORTEST_S <= span_s < _LONGEST_S:
        raise _UnfitError(
            f"values from {first:g} to {last:g} {unit} are no sweep of {_SHORTEST_S:g} to "
            f"{_LONGEST_S:g} s"
        )
    zero, meaning = _zero(first, last, stamp_ns / (NANOSECONDS_PER_SECOND * UNITS_S[unit]), rule)
    values -= zero
    values *= UNITS_S[unit]
    source = f"field {describe(name)} ({scalar.name}, {unit}, {meaning})"
    return PointTimes(values.astype(np.float32), source)


def _unit(first: float, last: float, kind: str) -> str:
    """The unit in which the values span a sweep."""
    if first == last:
        raise _UnfitError(f"all values are {first:g}")
    for unit in _USUAL_UNITS[kind]:
        if _SHORTEST_S <= (last - first) * UNITS_S[unit] < _LONGEST_S:
            return unit
    units = ", ".join(_USUAL_UNITS[kind])
    raise _UnfitError(f"values from {first:g} to {last:g} span no sweep in any of {units}")


def _zero(first: float, last: float, stamp: float, rule: TimeRule) -> tuple[float, str]:
    """The value that a point measured at the stamp has, and what that means for the others."""
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
