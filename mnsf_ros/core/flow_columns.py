# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Columns of the output clouds, of points and of objects: one row of a table for each."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.core.flow_estimate import FlowEstimate, TrackedObject
from mnsf_ros.drawing.color_wheel import packed_colors
from mnsf_ros.settings import OutputSettings

Values = Callable[[FlowEstimate, float], NDArray[Any] | None]


@dataclass(frozen=True)
class FlowColumn:
    """One value for each point.

    Attributes:
        name: Name of the field in a cloud.
        dtype: Type of the values, one that a PointField can have.
        missing: Value of points that are not finite, and of all points where the method has no
            such values.
        unit: SI; empty for numbers without one.
        text: Description, for the documents.
        values: From the estimate and the time to the next sweep in seconds to the values (N,) of
            the sweep's points; None where the method has none.
    """

    name: str
    dtype: DTypeLike
    missing: float
    unit: str
    text: str
    values: Values


def _flow(axis: int) -> Values:
    return lambda estimate, _interval_s: estimate.flow[:, axis]


def _velocity(axis: int) -> Values:
    def values(estimate: FlowEstimate, interval_s: float) -> NDArray[Any] | None:
        known = estimate.over_ground
        if known is None or interval_s <= 0:
            return None
        return known.motion[:, axis] / np.float32(interval_s)

    return values


def _speed(estimate: FlowEstimate, interval_s: float) -> NDArray[Any] | None:
    known = estimate.over_ground
    if known is None or interval_s <= 0:
        return None
    return _lengths(np.ascontiguousarray(known.motion), np.float32(1 / interval_s))


@compiled("float32[::1](float32[:, ::1], float32)")
def _lengths(motion: NDArray[np.float32], factor: np.float32) -> NDArray[np.float32]:
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


def _dynamic(estimate: FlowEstimate, _interval_s: float) -> NDArray[Any] | None:
    return None if estimate.over_ground is None else estimate.over_ground.dynamic


def _confidence(estimate: FlowEstimate, _interval_s: float) -> NDArray[Any] | None:
    return None if estimate.over_ground is None else estimate.over_ground.confidence


_FLOW_TEXT: Final = "displacement until the next sweep along {}, ego motion included"
_VELOCITY_TEXT: Final = "velocity over ground along {}, in the axes of this sweep"
_RGB_TEXT: Final = (
    "colour for viewers, 0x00RRGGBB: hue by direction, brightness by speed over ground"
)
_CONFIDENCE_TEXT: Final = "probability that the flow is less than 0.1 m off, 0 to 1"

# Colours are full from this speed on.
FULL_COLOR_M_S: Final = 5.0

# The order is that of the fields in the cloud. The documents have the same table; a test compares.
FLOW_COLUMNS: Final = (
    FlowColumn("flow_x", np.float32, np.nan, "m", _FLOW_TEXT.format("x"), _flow(0)),
    FlowColumn("flow_y", np.float32, np.nan, "m", _FLOW_TEXT.format("y"), _flow(1)),
    FlowColumn("flow_z", np.float32, np.nan, "m", _FLOW_TEXT.format("z"), _flow(2)),
    FlowColumn("vx", np.float32, np.nan, "m/s", _VELOCITY_TEXT.format("x"), _velocity(0)),
    FlowColumn("vy", np.float32, np.nan, "m/s", _VELOCITY_TEXT.format("y"), _velocity(1)),
    FlowColumn("vz", np.float32, np.nan, "m/s", _VELOCITY_TEXT.format("z"), _velocity(2)),
    FlowColumn("dynamic", np.uint8, 0, "", "1 if the point moves over ground, else 0", _dynamic),
    FlowColumn("confidence", np.float32, np.nan, "", _CONFIDENCE_TEXT, _confidence),
    FlowColumn("speed", np.float32, np.nan, "m/s", "speed over ground", _speed),
    FlowColumn("rgb", np.float32, 0, "", _RGB_TEXT, _rgb),
)
FLOW_NAMES: Final = tuple(column.name for column in FLOW_COLUMNS[:3])
_COMPACT_NAMES: Final = (*FLOW_NAMES, "dynamic")
COLOR_NAME: Final = "rgb"


def chosen_columns(output: OutputSettings) -> tuple[FlowColumn, ...]:
    """Returns the columns of the layout in the settings."""
    if output.layout == "compact":
        return tuple(column for column in FLOW_COLUMNS if column.name in _COMPACT_NAMES)
    return tuple(column for column in FLOW_COLUMNS if output.rgb or column.name != COLOR_NAME)


def flow_columns(
    estimate: FlowEstimate,
    interval_s: float,
    measured: NDArray[np.bool_],
    columns: Sequence[FlowColumn] = FLOW_COLUMNS,
) -> dict[str, NDArray[Any]]:
    """Returns columns of the table, by name.

    Args:
        estimate: The estimate.
        interval_s: Seconds to the next sweep; where it is not positive there are no velocities.
        measured: (M,) bool, the points of the cloud that are in the sweep, N of them.
        columns: Rows of the table.

    Returns:
        (M,) each, with the missing value where a point is not in the sweep.
    """
    return {
        column.name: _in_rows(
            column.dtype, column.missing, column.values(estimate, interval_s), measured
        )
        for column in columns
    }


def position_columns(
    xyz: NDArray[np.float32], measured: NDArray[np.bool_]
) -> dict[str, NDArray[Any]]:
    """Returns x, y, z by name, of the points (N, 3) of a sweep, in metres, as `flow_columns`."""
    return {
        name: _in_rows(np.float32, np.nan, xyz[:, axis], measured)
        for axis, name in enumerate("xyz")
    }


def _in_rows(
    dtype: DTypeLike, missing: float, values: NDArray[Any] | None, measured: NDArray[np.bool_]
) -> NDArray[Any]:
    """Returns values (N,) of the sweep in the rows (M,) of the cloud."""
    if values is not None and len(values) == len(measured):
        return np.asarray(values, dtype=dtype)
    result = np.full(len(measured), missing, dtype=dtype)
    if values is not None:
        result[measured] = values
    return result


@dataclass(frozen=True)
class ObjectColumn:
    """One value for each object.

    Attributes:
        name: Name of the field in a cloud.
        dtype: Type of the values, one that a PointField can have.
        unit: SI; empty for numbers without one.
        text: Description, for the documents.
        value: From an object to its value.
    """

    name: str
    dtype: DTypeLike
    unit: str
    text: str
    value: Callable[[TrackedObject], float]


def _of(attribute: str, axis: int | tuple[int, int]) -> Callable[[TrackedObject], float]:
    return lambda item: float(getattr(item, attribute)[axis])


def _covariance_columns() -> list[ObjectColumn]:
    """The upper triangle of the symmetric matrix, row by row."""
    state = (("x", "m"), ("y", "m"), ("z", "m"), ("vx", "m/s"), ("vy", "m/s"), ("vz", "m/s"))
    pairs = itertools.combinations_with_replacement(enumerate(state), 2)
    return [
        ObjectColumn(
            f"cov_{first}_{second}",
            np.float32,
            f"{unit} * {other_unit}",
            f"covariance of {first} and {second}",
            _of("covariance", (row, column)),
        )
        for (row, (first, unit)), (column, (second, other_unit)) in pairs
    ]


_CENTER_TEXT: Final = "center of the box along {}, frame of this sweep"

# The order is that of the fields in the cloud. The documents have the same table; a test compares.
OBJECT_COLUMNS: Final = (
    ObjectColumn("x", np.float32, "m", _CENTER_TEXT.format("x"), _of("center", 0)),
    ObjectColumn("y", np.float32, "m", _CENTER_TEXT.format("y"), _of("center", 1)),
    ObjectColumn("z", np.float32, "m", _CENTER_TEXT.format("z"), _of("center", 2)),
    ObjectColumn(
        "id",
        np.uint32,
        "",
        "number of the object, the same as long as it is followed",
        lambda item: item.track_id,
    ),
    ObjectColumn("length", np.float32, "m", "size along the heading", _of("size", 0)),
    ObjectColumn("width", np.float32, "m", "size across the heading", _of("size", 1)),
    ObjectColumn("height", np.float32, "m", "size along z", _of("size", 2)),
    ObjectColumn("yaw", np.float32, "rad", "heading about z, from x", lambda item: item.yaw),
    ObjectColumn("vx", np.float32, "m/s", _VELOCITY_TEXT.format("x"), _of("velocity", 0)),
    ObjectColumn("vy", np.float32, "m/s", _VELOCITY_TEXT.format("y"), _of("velocity", 1)),
    ObjectColumn("vz", np.float32, "m/s", _VELOCITY_TEXT.format("z"), _of("velocity", 2)),
    ObjectColumn(
        "age", np.float32, "s", "time since it was first seen to move", lambda item: item.age_s
    ),
    ObjectColumn(
        "num_points",
        np.uint32,
        "",
        "its points in this sweep; 0 while it is hidden and only predicted",
        lambda item: item.num_points,
    ),
    *_covariance_columns(),
)


def object_columns(objects: Sequence[TrackedObject]) -> dict[str, NDArray[Any]]:
    """Returns the columns of the table, by name: (M,) each, one row for each object."""
    return {
        column.name: np.array([column.value(item) for item in objects], dtype=column.dtype)
        for column in OBJECT_COLUMNS
    }
