"""A cloud made of arrays: layout and data, from which a message of any ROS stack can be built."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from msg_utils.cloud_layout import CloudLayout
from msg_utils.errors import MessageError, describe
from msg_utils.integers import UINT32_MAX, checked_integer
from msg_utils.point_fields import POINT_STEP_MAX, FieldLayout, byte_order, datatype_of

Columns = Mapping[str, npt.NDArray[Any]]


@dataclass(frozen=True, eq=False)
class EncodedCloud(CloudLayout):
    """What a message needs besides its header and `is_dense`; decodes like a message.

    `data` is (height * row_step,) uint8 in one piece and of its own memory, rows without padding.
    """

    data: npt.NDArray[np.uint8]

    @classmethod
    def allocate(
        cls,
        height: int,
        width: int,
        fields: tuple[FieldLayout, ...],
        point_step: int,
        *,
        is_bigendian: bool,
    ) -> EncodedCloud:
        """Make a cloud of zeros.

        Args:
            height: Rows of points.
            width: Points per row.
            fields: What a point consists of.
            point_step: Bytes per point.
            is_bigendian: Byte order of every field.

        Raises:
            MessageError: There are points but no fields, or more bytes than a message can state.
        """
        if height * width > 0 and not fields:
            msg = f"no fields, expected at least one for {height * width} points"
            raise MessageError(msg)
        checked_integer(point_step, "encoded point_step", maximum=POINT_STEP_MAX)
        row_step = checked_integer(width * point_step, "encoded row_step", maximum=UINT32_MAX)
        data = np.zeros(height * row_step, np.uint8)
        return cls(height, width, fields, is_bigendian, point_step, row_step, data)

    def write_column(self, field: FieldLayout, column: npt.NDArray[Any]) -> None:
        """Fill one field of all points.

        Args:
            field: A field of this cloud with one element.
            column: (height * width,) values in row order.
        """
        scalar = field.scalar.newbyteorder(byte_order(is_bigendian=self.is_bigendian))
        self.view(self.data, scalar, field.offset)[...] = column.reshape(self.height, self.width)


def column_fields(
    columns: Columns, num_points: int, start: int, *, aligned: bool
) -> tuple[FieldLayout, ...]:
    """Place one field per column, in their order.

    Args:
        columns: Name -> values.
        num_points: Length that every column must have.
        start: Bytes of the point that are taken already.
        aligned: Whether each field starts at a multiple of its size, or right after the last.

    Returns:
        One field of one element per column.

    Raises:
        MessageError: A column has no name, another length, or a type that no field can have.
    """
    fields = []
    for name, column in columns.items():
        _check_column(name, column, num_points)
        size = column.dtype.itemsize
        offset = _round_up(start, size) if aligned else start
        fields.append(FieldLayout(name, offset, datatype_of(column.dtype, name), 1))
        start = offset + size
    return tuple(fields)


def aligned_step(fields: tuple[FieldLayout, ...], end: int) -> int:
    """Bytes per point that keep the given fields at multiples of their size in every point."""
    return _round_up(end, max((field.scalar.itemsize for field in fields), default=1))


def _round_up(value: int, multiple: int) -> int:
    return -(-value // multiple) * multiple


def _check_column(name: object, column: object, num_points: int) -> None:
    if not isinstance(name, str) or not name:
        msg = f"name of a column is {describe(name)}, expected a string that is not empty"
        raise MessageError(msg)
    if not isinstance(column, np.ndarray):
        msg = f"column {describe(name)} is of type {type(column).__name__}, expected a NumPy array"
        raise MessageError(msg)
    if column.shape != (num_points,):
        msg = f"column {describe(name)} has shape {column.shape}, expected ({num_points},)"
        raise MessageError(msg)
