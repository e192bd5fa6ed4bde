# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Point cloud messages <-> NumPy arrays. Works on any object with the message's attributes."""

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Any, Final

import numpy as np
import numpy.typing as npt

from msg_utils.cloud_layout import (
    CloudLayout,
    Columns,
    EncodedCloud,
    PointCloudLike,
    read_only_bytes,
)
from msg_utils.errors import MessageError, checked_integer, describe
from msg_utils.no_returns import no_returns
from msg_utils.point_fields import FieldLayout, datatype_of, fields_end, point_dtype

_XYZ: Final = ("x", "y", "z")


def decode_points(cloud: PointCloudLike) -> npt.NDArray[Any]:
    """Views all fields of all points, whatever the layout, without a copy.

    Returns:
        (height, width) structured, one entry per field as `point_fields.point_dtype` names them, in
        the byte order of the message. It is read-only and refers to the memory of the message.

    Raises:
        MessageError: The layout contradicts itself or the data is too short.
    """
    return _view_points(cloud, CloudLayout.from_cloud(cloud))


def decode_xyz(cloud: PointCloudLike) -> tuple[npt.NDArray[np.float32], npt.NDArray[np.bool_]]:
    """Copies the positions of all points that were measured.

    Coordinates must be FLOAT32 or FLOAT64: integers have no unit in the message. A cloud without
    points needs no fields.

    Returns:
        xyz: (N, 3) float32, metres, native byte order, C-contiguous, of its own memory. Points row
            by row, without those of which x, y or z is NaN, infinite or beyond float32, and without
            `no_returns`.
        measured: (height * width,) bool, True for the N points of `xyz`: the mask of all columns.

    Raises:
        MessageError: The cloud cannot be decoded, or has no x, y or z of a floating point type.
    """
    layout = CloudLayout.from_cloud(cloud)
    points = _view_points(cloud, layout)
    if points.size == 0:
        return np.empty((0, 3), np.float32), np.empty(0, np.bool_)
    _check_coordinates(layout.fields)
    grid = np.empty((*points.shape, 3), np.float32)
    # Float64 beyond float32 becomes infinite, without a warning.
    with np.errstate(all="ignore"):
        for axis, name in enumerate(_XYZ):
            grid[..., axis] = points[name]
    xyz: npt.NDArray[np.float32] = grid.reshape(-1, 3)
    # Several times faster than `np.isfinite(xyz).all(axis=1)` and `xyz[finite]`.
    measured = np.isfinite(xyz[:, 0])
    measured &= np.isfinite(xyz[:, 1])
    measured &= np.isfinite(xyz[:, 2])
    if not measured.all():
        xyz = np.compress(measured, xyz, axis=0)
    if (none := no_returns(xyz)).any():
        measured[np.flatnonzero(measured)[none]] = False
        xyz = np.compress(~none, xyz, axis=0)
    return xyz, measured


def encode_with_columns(
    cloud: PointCloudLike,
    columns: Columns,
    *,
    clash_prefix: str,
    rows: npt.NDArray[np.intp] | None = None,
) -> EncodedCloud:
    """Returns the encoding of a cloud with further fields for every point.

    All fields of the cloud keep offset, datatype, count and the exact bytes of their values, also
    where they overlap or repeat a name; points keep their order, the cloud its byte order. New
    fields follow the last one, each at a multiple of its size. A field of the cloud with the name
    of a column is renamed, see `clash_names`. Padding at the end of points and rows is dropped.
    With `rows` (M,), counted row by row, the cloud has only these points, in one row.

    Raises:
        MessageError: The cloud cannot be decoded, or a column does not fit it.
    """
    layout = CloudLayout.from_cloud(cloud)
    buffer = read_only_bytes(cloud, layout)
    others = clash_names([field.name for field in layout.fields], columns, clash_prefix)
    kept = tuple(replace(field, name=others.get(field.name, field.name)) for field in layout.fields)
    kept_size = fields_end(kept)
    # One opaque element per point: the fastest copy, and no value is interpreted.
    points = layout.view(buffer, np.dtype((np.void, kept_size)))
    if rows is not None:
        points = np.take(points.reshape(1, -1), rows, axis=1)
    added = _column_fields(columns, points.size, kept_size, aligned=True)
    # Fields stay at multiples of their size from point to point, too.
    largest = max((field.scalar.itemsize for field in added), default=1)
    return EncodedCloud.of(
        (points.shape[0], points.shape[1]),
        kept + added,
        _round_up(fields_end(kept + added), largest),
        columns,
        is_bigendian=layout.is_bigendian,
        kept=points.reshape(-1),
    )


def encode_columns(columns: Columns, height: int, width: int) -> EncodedCloud:
    """Returns the encoding of a little-endian cloud of columns, in their order and without gaps.

    Raises:
        MessageError: A column does not fit, or there are points but no columns.
    """
    rows, points_per_row = checked_integer(height, "height"), checked_integer(width, "width")
    fields = _column_fields(columns, rows * points_per_row, 0, aligned=False)
    return EncodedCloud.of((rows, points_per_row), fields, fields_end(fields), columns)


def clash_names(names: Collection[str], columns: Iterable[str], prefix: str) -> dict[str, str]:
    """Returns new names of the fields of a cloud that have the name of a column.

    The prefix is repeated until a name is unique.
    """
    wanted = set(columns)
    taken, others = wanted | set(names), {}
    for name in dict.fromkeys(name for name in names if name in wanted):
        other = prefix + name
        while other in taken:
            other = prefix + other
        others[name] = other
        taken.add(other)
    return others


def _column_fields(
    columns: Columns, num_points: int, start: int, *, aligned: bool
) -> tuple[FieldLayout, ...]:
    """One field per column from byte `start` on, each at a multiple of its size if aligned."""
    fields = []
    for name, column in columns.items():
        if column.shape != (num_points,):
            where = f"column {describe(name)}"
            raise MessageError(f"{where} has shape {column.shape}, expected ({num_points},)")
        size = column.dtype.itemsize
        offset = _round_up(start, size) if aligned else start
        fields.append(FieldLayout(name, offset, datatype_of(column.dtype, name), 1))
        start = offset + size
    return tuple(fields)


def _round_up(value: int, multiple: int) -> int:
    return -(-value // multiple) * multiple


def _view_points(cloud: PointCloudLike, layout: CloudLayout) -> npt.NDArray[Any]:
    buffer = read_only_bytes(cloud, layout)
    # The larger of the two differs from point_step only without points, see CloudLayout.from_cloud.
    point_size = max(layout.point_step, fields_end(layout.fields))
    return layout.view(
        buffer, point_dtype(layout.fields, point_size, is_bigendian=layout.is_bigendian)
    )


def _check_coordinates(fields: tuple[FieldLayout, ...]) -> None:
    by_name = {field.name: field for field in reversed(fields)}
    for name in _XYZ:
        field = by_name.get(name)
        if field is None:
            names = describe([field.name for field in fields])
            raise MessageError(f"no field {name!r}, expected x, y and z; the fields are {names}")
        if field.scalar.kind != "f" or field.num_elements > 1:
            raise MessageError(
                f"field {name!r} is {field.num_elements} x {field.scalar.name.upper()}, "
                f"expected 1 x FLOAT32 or 1 x FLOAT64"
            )
