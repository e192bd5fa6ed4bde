"""Field list of a point cloud <-> NumPy structured dtype."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Final, Literal, Protocol

import numpy as np

from msg_utils.errors import MessageError, describe
from msg_utils.integers import INT32_MAX, UINT8_MAX, UINT32_MAX, checked_integer

if TYPE_CHECKING:
    from collections.abc import Iterable, Mapping, Sequence

# What NumPy can address; a message could state twice as much.
POINT_STEP_MAX: Final = INT32_MAX

# The constants of sensor_msgs/PointField.
_DATATYPES: Final[Mapping[int, np.dtype[Any]]] = {
    1: np.dtype(np.int8),
    2: np.dtype(np.uint8),
    3: np.dtype(np.int16),
    4: np.dtype(np.uint16),
    5: np.dtype(np.int32),
    6: np.dtype(np.uint32),
    7: np.dtype(np.float32),
    8: np.dtype(np.float64),
}
_DATATYPES_TEXT: Final = ", ".join(
    f"{code} ({scalar.name.upper()})" for code, scalar in _DATATYPES.items()
)


class PointFieldLike(Protocol):
    """Any object with the attributes of sensor_msgs/PointField."""

    @property
    def name(self) -> str:
        """Name of the field, possibly empty or not unique."""

    @property
    def offset(self) -> int:
        """Bytes from the start of the point."""

    @property
    def datatype(self) -> int:
        """Code of the type of one element."""

    @property
    def count(self) -> int:
        """Number of elements."""


@dataclass(frozen=True)
class FieldLayout:
    """One field of a point: the values of sensor_msgs/PointField.

    `count` 0 is kept but means 1, as PCL reads it: old drivers leave it unset.
    """

    name: str
    offset: int
    datatype: int
    count: int

    @property
    def scalar(self) -> np.dtype[Any]:
        """Type of one element, native byte order."""
        return _DATATYPES[self.datatype]

    @property
    def num_elements(self) -> int:
        """Number of elements, at least 1."""
        return max(self.count, 1)

    @property
    def end(self) -> int:
        """Bytes from the start of the point to the end of the field."""
        return self.offset + self.num_elements * self.scalar.itemsize


def decode_field(field: PointFieldLike) -> FieldLayout:
    """Check one field of a message and copy its values.

    Args:
        field: A message's field.

    Returns:
        The same values, of which `scalar` and `end` can be computed.

    Raises:
        MessageError: The name is no string, the datatype has no meaning, or an integer is negative
            or larger than its type.
    """
    name: object = field.name
    if not isinstance(name, str):
        msg = f"name of a field is {describe(name)}, expected a string"
        raise MessageError(msg)
    where = f"of field {describe(name)}"
    datatype = checked_integer(field.datatype, f"datatype {where}", maximum=UINT8_MAX)
    if datatype not in _DATATYPES:
        msg = f"datatype {where} is {datatype}, expected one of {_DATATYPES_TEXT}"
        raise MessageError(msg)
    return FieldLayout(
        name=name,
        offset=checked_integer(field.offset, f"offset {where}", maximum=UINT32_MAX),
        datatype=datatype,
        count=checked_integer(field.count, f"count {where}", maximum=UINT32_MAX),
    )


def datatype_of(scalar: np.dtype[Any], name: str) -> int:
    """Find the datatype code of a NumPy type of any byte order.

    Args:
        scalar: Type of a column.
        name: Name of the column, for the error.

    Returns:
        The code.

    Raises:
        MessageError: A cloud cannot hold this type.
    """
    for code, known in _DATATYPES.items():
        if scalar.kind == known.kind and scalar.itemsize == known.itemsize:
            return code
    msg = f"column {describe(name)} is of type {scalar}, expected one of {_DATATYPES_TEXT}"
    raise MessageError(msg)


def fields_end(fields: Iterable[FieldLayout]) -> int:
    """Bytes from the start of the point to the end of the field that reaches furthest."""
    return max((field.end for field in fields), default=0)


def byte_order(*, is_bigendian: bool) -> Literal["<", ">"]:
    """NumPy's sign for the byte order of a cloud."""
    return ">" if is_bigendian else "<"


def point_dtype(
    fields: Sequence[FieldLayout], point_step: int, *, is_bigendian: bool
) -> np.dtype[Any]:
    """Build the structured type of one point.

    Fields may come in any order, overlap, leave gaps and lie at any offset. NumPy needs unique
    names: the first field of a name keeps it, field number i of a repeated name becomes `name_i`,
    one of an empty name `unnamed_i`. A field of more than one element is a subarray.

    Args:
        fields: Checked fields, all within `point_step`.
        point_step: Bytes per point, at most `POINT_STEP_MAX`.
        is_bigendian: Byte order of every field.

    Returns:
        Type of `point_step` bytes.
    """
    order = byte_order(is_bigendian=is_bigendian)
    scalars = [field.scalar.newbyteorder(order) for field in fields]
    return np.dtype(
        {
            "names": _unique_names(fields),
            "formats": [
                scalar if field.num_elements == 1 else (scalar, (field.num_elements,))
                for field, scalar in zip(fields, scalars, strict=True)
            ],
            "offsets": [field.offset for field in fields],
            "itemsize": point_step,
        }
    )


def _unique_names(fields: Sequence[FieldLayout]) -> list[str]:
    reserved = {field.name for field in fields}
    seen = {""}
    names: list[str] = []
    for index, field in enumerate(fields):
        name = field.name
        if name in seen:
            name = f"{field.name or 'unnamed'}_{index}"
            while name in reserved:
                name += "_"
            reserved.add(name)
        seen.add(name)
        names.append(name)
    return names
