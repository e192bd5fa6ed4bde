# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Field list of a point cloud <-> NumPy structured dtype."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np

from msg_utils.errors import INT32_MAX, MessageError, checked_integer, describe

# Any object with the attributes of sensor_msgs/PointField.
PointFieldLike: TypeAlias = Any

# The limit of NumPy; a message could state twice as much.
POINT_STEP_MAX: Final = INT32_MAX

# The constants of sensor_msgs/PointField.
_NAMES: Final = ("int8", "uint8", "int16", "uint16", "int32", "uint32", "float32", "float64")
_DATATYPES: Final[Mapping[int, np.dtype[Any]]] = {
    code: np.dtype(name) for code, name in enumerate(_NAMES, start=1)
}
_DATATYPES_TEXT: Final = ", ".join(
    f"{code} ({scalar.name.upper()})" for code, scalar in _DATATYPES.items()
)


@dataclass(frozen=True)
class FieldLayout:
    """One field of a point: the values of sensor_msgs/PointField.

    `count` 0 is kept but means 1, as in PCL: old drivers leave it unset.
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
    """Checks one field of a message and copies its values.

    Raises:
        MessageError: The name is no string, the datatype has no meaning, or an integer is negative
            or larger than its type.
    """
    name: object = field.name
    if not isinstance(name, str):
        raise MessageError(f"name of a field is {describe(name)}, expected a string")
    where = f"of field {describe(name)}"
    datatype = checked_integer(field.datatype, f"datatype {where}", 255)
    if datatype not in _DATATYPES:
        raise MessageError(f"datatype {where} is {datatype}, expected one of {_DATATYPES_TEXT}")
    offset = checked_integer(field.offset, f"offset {where}")
    count = checked_integer(field.count, f"count {where}")
    return FieldLayout(name, offset, datatype, count)


def datatype_of(scalar: np.dtype[Any], name: str) -> int:
    """Returns the datatype code of a column's NumPy type, of any byte order.

    Raises:
        MessageError: A cloud cannot hold this type.
    """
    for code, known in _DATATYPES.items():
        if scalar.kind == known.kind and scalar.itemsize == known.itemsize:
            return code
    raise MessageError(
        f"column {describe(name)} is of type {scalar}, expected one of {_DATATYPES_TEXT}"
    )


def fields_end(fields: Iterable[FieldLayout]) -> int:
    """Returns the bytes from the start of the point to the end of its last field."""
    return max((field.end for field in fields), default=0)


def point_dtype(
    fields: Sequence[FieldLayout], point_step: int, *, is_bigendian: bool
) -> np.dtype[Any]:
    """Returns the structured type of one point, of `point_step` bytes.

    Fields may come in any order, overlap, leave gaps and lie at any offset. NumPy needs unique
    names: the first field of a name keeps it, field number i of a repeated name becomes `name_i`,
    one of an empty name `unnamed_i`. A field of more than one element is a subarray.
    """
    formats: list[Any] = []
    for field in fields:
        scalar = field.scalar.newbyteorder(">" if is_bigendian else "<")
        formats.append(scalar if field.num_elements == 1 else (scalar, (field.num_elements,)))
    return np.dtype(
        {
            "names": _unique_names(fields),
            "formats": formats,
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
