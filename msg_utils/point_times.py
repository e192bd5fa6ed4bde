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


@dataclass(frozen=True, eq=False)
class PointTimes:
    """Times of the points of a cloud.

    Attributes:
        times_s: (N,) float32, seconds after the stamp of the cloud, negative before it; None if
            unknown.
        source: Description of field, unit and stamp, the same for similar clouds; `none`.
        fault: Fault of the times in the cloud; empty without a fault or without times.
    """

    times_s: npt.NDArray[np.float32] | None
    source: str = NO_FIELD
    fault: str = ""


class _UnfitError(ValueError):
    """The values of a field cannot be times of a sweep."""


def decode_times(
    cloud: PointCloudLike, wanted: npt.NDArray[np.bool_], stamp_ns: int, rule: TimeRuleLike
) -> PointTimes:
    """Reads the times of the wanted points (height * width,) of a cloud of this stamp.

    Unfit times are a fault of the result, not an error. `auto` of the rule is decided by type, name
    and values of the fields.

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
    rule: TimeRuleLike,
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
    """Returns the unit in which the values span a sweep."""
    if first == last:
        raise _UnfitError(f"all values are {first:g}")
    for unit in _USUAL_UNITS[kind]:
        if _SHORTEST_S <= (last - first) * UNITS_S[unit] < _LONGEST_S:
            return unit
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
