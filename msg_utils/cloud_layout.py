# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Layout of the points of a cloud in its data, NumPy views of them, and their encoding."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from msg_utils.errors import MessageError, checked_integer, describe
from msg_utils.point_fields import POINT_STEP_MAX, FieldLayout, decode_field

# Any object with the attributes of sensor_msgs/PointCloud2 but its header.
PointCloudLike: TypeAlias = Any
# Name -> (height * width,) values in row order, of a type that a field can have.
Columns: TypeAlias = Mapping[str, npt.NDArray[Any]]

# Points are written in blocks, field by field: the bytes of a block stay in the cache.
_BLOCK_POINTS: Final = 4096


@dataclass(frozen=True)
class CloudLayout:
    """A checked layout: every field lies within its point, every point within its row."""

    height: int
    width: int
    fields: tuple[FieldLayout, ...]
    is_bigendian: bool
    point_step: int
    row_step: int

    @classmethod
    def from_cloud(cls, cloud: PointCloudLike) -> "CloudLayout":
        """Checks the layout of a message.

        `point_step` and `row_step` of a cloud without points may be too small: nothing is read, and
        drivers leave both unset in empty clouds. Data of exactly the bytes of the points has rows
        without padding, whatever `row_step` says: drivers set 0, or the size of the whole cloud.

        Raises:
            MessageError: The layout contradicts itself.
        """
        layout = cls(
            height=checked_integer(cloud.height, "height"),
            width=checked_integer(cloud.width, "width"),
            fields=tuple(decode_field(field) for field in cloud.fields),
            is_bigendian=bool(cloud.is_bigendian),
            point_step=checked_integer(cloud.point_step, "point_step", POINT_STEP_MAX),
            row_step=checked_integer(cloud.row_step, "row_step"),
        )
        row_bytes = layout.width * layout.point_step
        if layout.row_step != row_bytes and _length(cloud.data) == layout.height * row_bytes:
            layout = replace(layout, row_step=row_bytes)
        layout._check()
        return layout

    @property
    def num_points(self) -> int:
        """Number of points, a Python integer without overflow."""
        return self.height * self.width

    @property
    def num_bytes(self) -> int:
        """Bytes from the first byte of the first point to the last byte of the last one."""
        if self.num_points == 0:
            return 0
        return (self.height - 1) * self.row_step + self.width * self.point_step

    def view(self, buffer: npt.NDArray[np.uint8], dtype: np.dtype[Any]) -> npt.NDArray[Any]:
        """Views the first bytes of every point as (height, width) of dtype, uncopied."""
        shape = (self.height, self.width)
        if self.num_points == 0:
            return np.empty(shape, dtype)
        return np.ndarray(shape, dtype, buffer, 0, (self.row_step, self.point_step))

    def _check(self) -> None:
        limit = self.point_step if self.num_points else POINT_STEP_MAX
        if limit == 0:
            raise MessageError(f"point_step is 0, expected at least 1 for {self.num_points} points")
        for field in self.fields:
            if field.end > limit:
                raise MessageError(
                    f"field {describe(field.name)} (offset {field.offset}, count {field.count}, "
                    f"{field.scalar.name.upper()}) ends at byte {field.end} of the point, "
                    f"expected at most {limit}"
                )
        row_bytes = self.width * self.point_step
        if self.num_points and self.row_step < row_bytes:
            raise MessageError(
                f"row_step is {self.row_step}, expected at least {row_bytes} (width {self.width} x "
                f"point_step {self.point_step})"
            )


def _length(data: object) -> int | None:
    """Number of bytes of a buffer; None where it is none, which `read_only_bytes` refuses."""
    try:
        return memoryview(data).nbytes  # type: ignore[arg-type]
    except (BufferError, TypeError, ValueError):
        return None


def read_only_bytes(cloud: PointCloudLike, layout: CloudLayout) -> npt.NDArray[np.uint8]:
    """Views the data of a cloud as read-only bytes, without a copy.

    Padding after the last row may be missing, and further data is ignored.

    Raises:
        MessageError: The data is not bytes in one piece, or shorter than the layout says.
    """
    try:
        buffer = np.frombuffer(cloud.data, np.uint8)
    except (BufferError, TypeError, ValueError) as error:
        kind = type(cloud.data).__name__
        raise MessageError(
            f"data is of type {kind}, expected bytes in one piece: {error}"
        ) from None
    if buffer.size < layout.num_bytes:
        raise MessageError(
            f"data has {buffer.size} bytes, expected at least {layout.num_bytes} "
            f"(height {layout.height}, width {layout.width}, point_step {layout.point_step}, "
            f"row_step {layout.row_step})"
        )
    buffer.flags.writeable = False
    return buffer


@dataclass(frozen=True, eq=False)
class EncodedCloud(CloudLayout):
    """A cloud without header and `is_dense`, rows without padding; decodes like a message.

    Attributes:
        sources: Places in a point, types there, and values (height * width,).
    """

    sources: Sequence[tuple[int, npt.DTypeLike, npt.NDArray[Any]]]

    @classmethod
    def of(
        cls,
        shape: tuple[int, int],
        fields: tuple[FieldLayout, ...],
        point_step: int,
        columns: Columns,
        *,
        is_bigendian: bool = False,
        kept: npt.NDArray[Any] | None = None,
    ) -> "EncodedCloud":
        """Returns the cloud of a height and a width.

        The columns are its last fields; `kept` (height * width,) are the first bytes of each point.

        Raises:
            MessageError: There are points but no fields, or more bytes than a message can state.
        """
        height, width = shape
        if height * width > 0 and not fields:
            raise MessageError(f"no fields, expected at least one for {height * width} points")
        checked_integer(point_step, "encoded point_step", POINT_STEP_MAX)
        row_step = checked_integer(width * point_step, "encoded row_step")
        checked_integer(height * row_step, "encoded size")
        added = fields[len(fields) - len(columns) :]
        sources: list[tuple[int, npt.DTypeLike, npt.NDArray[Any]]] = [
            (field.offset, field.scalar.newbyteorder(">" if is_bigendian else "<"), column)
            for field, column in zip(added, columns.values(), strict=True)
        ]
        if kept is not None and kept.itemsize:
            sources.insert(0, (0, kept.dtype, kept))
        return cls(height, width, fields, is_bigendian, point_step, row_step, sources)

    @cached_property
    def data(self) -> npt.NDArray[np.uint8]:
        """The bytes of the points, (height * row_step,), of their own memory."""
        data = np.zeros(self.num_bytes, np.uint8)
        self.write(data)
        return data

    def write(self, data: npt.NDArray[np.uint8]) -> None:
        """Fills `num_bytes` bytes, which must be 0."""
        number = self.num_points
        if number == 0:
            return
        pairs: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = [
            (np.ndarray(number, dtype, data, offset, (self.point_step,)), source)
            for offset, dtype, source in self.sources
        ]
        for start in range(0, number, _BLOCK_POINTS):
            block = slice(start, start + _BLOCK_POINTS)
            for target, source in pairs:
                target[block] = source[block]
