# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Columns of the output clouds, of points and of objects; `docs/ros_interface.md` has texts."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mnsf_ros.arrays import Bools, Floats32
from mnsf_ros.compiled import compiled
from mnsf_ros.core.flow_estimate import FlowEstimate, TrackedObject
from mnsf_ros.drawing.color_wheel import FULL_COLOR_M_S, packed_colors
from mnsf_ros.settings import OutputSettings

# From the estimate and the seconds to the next sweep to the values (N,) of the points of the sweep;
# None if the method has no such values.
Values = Callable[[FlowEstimate, float], NDArray[Any] | None]


@dataclass(frozen=True)
class FlowColumn:
    """One value for each point."""

    name: str  # of the field in a cloud
    dtype: DTypeLike  # one that a PointField can have
    missing: float  # for points that were not measured, and for all points without values
    values: Values


def _flow(axis: int, estimate: FlowEstimate, _interval_s: float) -> NDArray[Any]:
    return estimate.flow[:, axis]


def _velocity(axis: int, estimate: FlowEstimate, interval_s: float) -> NDArray[Any] | None:
    known = estimate.over_ground
    if known is None or interval_s <= 0:
        return None
    return known.motion[:, axis] / np.float32(interval_s)


def _speed(estimate: FlowEstimate, interval_s: float) -> NDArray[Any] | None:
    known = estimate.over_ground
    if known is None or interval_s <= 0:
        return None
    return _lengths(np.ascontiguousarray(known.motion), np.float32(1 / interval_s))


@compiled("float32[::1](float32[:, ::1], float32)")
def _lengths(motion: Floats32, factor: np.float32) -> Floats32:
    """The lengths (N,) of vectors (N, 3), times a factor."""
    result = np.empty(len(motion), np.float32)
    for row in range(len(motion)):
        x, y, z = motion[row, 0], motion[row, 1], motion[row, 2]
        result[row] = np.sqrt(x * x + y * y + z * z) * factor
    return result


def _rgb(estimate: FlowEstimate, interval_s: float) -> NDArray[Any] | None:
    """Colours of the motion over ground, or of the flow where that is unknown."""
    if interval_s <= 0:
        return None
    known = estimate.over_ground
    motion = estimate.flow if known is None else known.motion
    # As PCL packs them: the bits of a float32.
    return packed_colors(motion, FULL_COLOR_M_S * interval_s).view(np.float32)


def _over_ground(name: str, estimate: FlowEstimate, _interval_s: float) -> NDArray[Any] | None:
    return getattr(estimate.over_ground, name, None)


FLOW_NAMES: Final = ("flow_x", "flow_y", "flow_z")
COLOR_NAME: Final = "rgb"
_COMPACT_NAMES: Final = (*FLOW_NAMES, "dynamic")
# The order is that of the fields in the cloud. The documents have the same table; a test compares.
FLOW_COLUMNS: Final = (
    *(FlowColumn(f"flow_{n}", np.float32, np.nan, partial(_flow, k)) for k, n in enumerate("xyz")),
    *(FlowColumn(f"v{n}", np.float32, np.nan, partial(_velocity, k)) for k, n in enumerate("xyz")),
    FlowColumn("dynamic", np.uint8, 0, partial(_over_ground, "dynamic")),
    FlowColumn("confidence", np.float32, np.nan, partial(_over_ground, "confidence")),
    FlowColumn("speed", np.float32, np.nan, _speed),
    FlowColumn(COLOR_NAME, np.float32, 0, _rgb),
)


def chosen_columns(output: OutputSettings) -> tuple[FlowColumn, ...]:
    """Returns the columns of the layout in the settings."""
    if output.layout == "compact":
        return tuple(column for column in FLOW_COLUMNS if column.name in _COMPACT_NAMES)
    return tuple(column for column in FLOW_COLUMNS if output.rgb or column.name != COLOR_NAME)


def flow_columns(
    estimate: FlowEstimate,
    interval_s: float,
    measured: Bools,
    columns: Sequence[FlowColumn] = FLOW_COLUMNS,
) -> dict[str, NDArray[Any]]:
    """Returns columns (M,) of the table, by name.

    `interval_s` is the time to the next sweep; there are no velocities if it is not positive. The
    mask `measured` (M,) has the N points of the cloud that are in the sweep.
    """
    return {
        column.name: _in_rows(
            column.dtype, column.missing, column.values(estimate, interval_s), measured
        )
        for column in columns
    }


def position_columns(xyz: Floats32, measured: Bools) -> dict[str, NDArray[Any]]:
    """Returns x, y, z by name, of the points (N, 3) of a sweep, in metres, as `flow_columns`."""
    return {
        name: _in_rows(np.float32, np.nan, xyz[:, axis], measured)
        for axis, name in enumerate("xyz")
    }


def _in_rows(
    dtype: DTypeLike, missing: float, values: NDArray[Any] | None, measured: Bools
) -> NDArray[Any]:
    """Returns values (N,) of the sweep in the rows (M,) of the cloud."""
    if values is not None and len(values) == len(measured):
        return np.asarray(values, dtype=dtype)
    result = np.full(len(measured), missing, dtype=dtype)
    if values is not None:
        result[measured] = values
    return result


_STATE: Final = ("x", "y", "z", "vx", "vy", "vz")
# The upper triangle of the symmetric matrix, row by row.
_UPPER: Final = np.triu_indices(len(_STATE))
# The order is that of the fields in the cloud. The documents have the same table; a test compares.
OBJECT_ROW: Final = np.dtype(
    [
        *((name, np.float32) for name in "xyz"),
        ("id", np.uint32),
        *((name, np.float32) for name in ("length", "width", "height", "yaw", "vx", "vy", "vz")),
        *((name, np.float32) for name in ("turn_rate", "age")),
        ("num_points", np.uint32),
        *((f"cov_{_STATE[a]}_{_STATE[b]}", np.float32) for a, b in zip(*_UPPER, strict=True)),
    ]
)


def object_columns(objects: Sequence[TrackedObject]) -> dict[str, NDArray[Any]]:
    """Returns the columns of `OBJECT_ROW`, by name: (M,) each, one row for each object."""
    rows = np.array([_object_row(item) for item in objects], OBJECT_ROW)
    return {name: np.ascontiguousarray(rows[name]) for name in OBJECT_ROW.names or ()}


def _object_row(item: TrackedObject) -> tuple[float, ...]:
    box = (*item.center, item.track_id, *item.size, item.yaw)
    others = (item.turn_rate, item.age_s, item.num_points)
    return (*box, *item.velocity, *others, *item.covariance[_UPPER])
