"""Where the points of a cloud lie in its data, and NumPy views of them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
import numpy.typing as npt

from msg_utils.errors import MessageError, describe
from msg_utils.integers import UINT32_MAX, checked_integer
from msg_utils.point_fields import POINT_STEP_MAX, FieldLayout, PointFieldLike, decode_field

if TYPE_CHECKING:
    from array import array
    from collections.abc import Sequence


class PointCloudLike(Protocol):
    """Any object with these attributes of sensor_msgs/PointCloud2."""

    @property
    def height(self) -> int:
        """Rows of points; 1 for an unorganized cloud."""

    @property
    def width(self) -> int:
        """Points per row."""

    @property
    def fields(self) -> Sequence[PointFieldLike]:
        """What a point consists of."""

    @property
    def is_bigendian(self) -> bool:
        """Byte order of every field."""

    @property
    def point_step(self) -> int:
        """Bytes from one point to the next."""

    @property
    def row_step(self) -> int:
        """Bytes from one row to the next."""

    @property
    def data(self) -> array[int] | bytes | bytearray | memoryview | npt.NDArray[np.uint8]:
        """Bytes in one piece."""


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
    def from_cloud(cls, cloud: PointCloudLike) -> CloudLayout:
        """Check the layout that a message states.

        A cloud without points is let through with a `point_step` or `row_step` that is too small:
        nothing is read, and empty clouds in the wild leave both unset.

        Raises:
            MessageError: The layout contradicts itself.
        """
        layout = cls(
            height=checked_integer(cloud.height, "height", maximum=UINT32_MAX),
            width=checked_integer(cloud.width, "width", maximum=UINT32_MAX),
            fields=tuple(decode_field(field) for field in cloud.fields),
            is_bigendian=bool(cloud.is_bigendian),
            point_step=checked_integer(cloud.point_step, "point_step", maximum=POINT_STEP_MAX),
            row_step=checked_integer(cloud.row_step, "row_step", maximum=UINT32_MAX),
        )
        layout._check_fields()
        if layout.num_points > 0:
            layout._check_row_step()
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

    def view(
        self, buffer: npt.NDArray[np.uint8], dtype: np.dtype[Any], offset: int = 0
    ) -> npt.NDArray[Any]:
        """View the same bytes of every point, without a copy.

        Args:
            buffer: (>= num_bytes,) data of the cloud.
            dtype: Type to read there, at most `point_step - offset` bytes.
            offset: Bytes from the start of the point.

        Returns:
            (height, width) of dtype, read-only if the buffer is.
        """
        shape = (self.height, self.width)
        if self.num_points == 0:
            return np.empty(shape, dtype)
        return np.ndarray(shape, dtype, buffer, offset, (self.row_step, self.point_step))

    def _check_fields(self) -> None:
        if self.num_points > 0 and self.point_step == 0:
            msg = (
                f"point_step is 0, expected at least 1 for the {self.num_points} points of a cloud "
                f"of height {self.height} and width {self.width}"
            )
            raise MessageError(msg)
        limit, limit_name = self.point_step, "point_step "
        if self.num_points == 0:
            limit, limit_name = POINT_STEP_MAX, ""
        for field in self.fields:
            if field.end > limit:
                msg = (
                    f"field {describe(field.name)} (offset {field.offset}, count {field.count}, "
                    f"{field.scalar.name.upper()}) ends at byte {field.end} of the point, "
                    f"expected at most {limit_name}{limit}"
                )
                raise MessageError(msg)

    def _check_row_step(self) -> None:
        if self.row_step < self.width * self.point_step:
            msg = (
                f"row_step is {self.row_step}, expected at least {self.width * self.point_step} "
                f"(width {self.width} x point_step {self.point_step})"
            )
            raise MessageError(msg)


def read_only_bytes(cloud: PointCloudLike, layout: CloudLayout) -> npt.NDArray[np.uint8]:
    """View the data of a cloud as read-only bytes, without a copy.

    Only the bytes of the points are asked for: padding may be missing after the last row, and more
    data than the layout needs is ignored.

    Args:
        cloud: The message.
        layout: Its checked layout.

    Returns:
        (>= layout.num_bytes,) bytes of the message itself.

    Raises:
        MessageError: The data is not bytes in one piece, or shorter than the layout says.
    """
    try:
        buffer = np.frombuffer(cloud.data, np.uint8)
    except (BufferError, TypeError, ValueError) as error:
        msg = f"data is of type {type(cloud.data).__name__}, expected bytes in one piece: {error}"
        raise MessageError(msg) from None
    if buffer.size < layout.num_bytes:
        msg = (
            f"data has {buffer.size} bytes, expected at least {layout.num_bytes} "
            f"(height {layout.height}, width {layout.width}, point_step {layout.point_step}, "
            f"row_step {layout.row_step})"
        )
        raise MessageError(msg)
    buffer.flags.writeable = False
    return buffer
