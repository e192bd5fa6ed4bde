# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What is said of a tracked object: one row of a table for each value."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import DTypeLike, NDArray

from mnsf_ros.core.flow_estimate import TrackedObject


@dataclass(frozen=True)
class ObjectColumn:
    """One value for each object.

    Attributes:
        name: Of the field in a cloud.
        dtype: Type of the values, one that a PointField can have.
        unit: SI; empty for numbers without one.
        text: What it is, for the documents.
        value: Gives the value of an object.
    """

    name: str
    dtype: DTypeLike
    unit: str
    text: str
    value: Callable[[TrackedObject], float]


def _of(attribute: str, axis: int | tuple[int, int]) -> Callable[[TrackedObject], float]:
    return lambda item: float(getattr(item, attribute)[axis])


def _covariance_columns() -> list[ObjectColumn]:
    """The upper triangle, row by row: what a symmetric matrix has."""
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
_VELOCITY_TEXT: Final = "velocity over ground along {}, in the axes of this sweep"

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
