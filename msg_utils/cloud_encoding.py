# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Encoding of clouds: their layout, and the values of their bytes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final, TypeAlias

import numpy as np
import numpy.typing as npt

from msg_utils.cloud_layout import CloudLayout, EncodedCloud
from msg_utils.errors import MessageError, checked_integer
from msg_utils.point_fields import POINT_STEP_MAX, FieldLayout

# Name -> (height * width,) values in row order, of a type that a field can have.
Columns: TypeAlias = Mapping[str, npt.NDArray[Any]]

# Points are written in blocks, field by field: the bytes of a block stay in the cache.
_BLOCK_POINTS: Final = 4096


@dataclass(frozen=True, eq=False)
class KeptBytes:
    """The first bytes of each point of another cloud."""

    layout: CloudLayout
    data: npt.NDArray[np.uint8]
    size: int


@dataclass(frozen=True, eq=False)
class CloudEncoding:
    """The layout of a cloud without padding of rows, and the sources of its bytes."""

    layout: CloudLayout
    columns: tuple[tuple[FieldLayout, npt.NDArray[Any]], ...]
    kept: KeptBytes | None = None

    @classmethod
    def of(
        cls,
        shape: tuple[int, int],
        fields: tuple[FieldLayout, ...],
        point_step: int,
        columns: Columns,
        *,
        is_bigendian: bool = False,
        kept: KeptBytes | None = None,
    ) -> CloudEncoding:
        """Returns the encoding of a cloud of a height and a width; the columns are its last fields.

        Raises:
            MessageError: There are points but no fields, or more bytes than a message can state.
        """
        height, width = shape
        if height * width > 0 and not fields:
            raise MessageError(f"no fields, expected at least one for {height * width} points")
        checked_integer(point_step, "encoded point_step", POINT_STEP_MAX)
        row_step = checked_integer(width * point_step, "encoded row_step")
        checked_integer(height * row_step, "encoded size")
        layout = CloudLayout(height, width, fields, is_bigendian, point_step, row_step)
        added = fields[len(fields) - len(columns) :]
        return cls(layout, tuple(zip(added, columns.values(), strict=True)), kept)

    def encoded(self) -> EncodedCloud:
        """Returns the cloud with data of its own memory."""
        data = np.zeros(self.layout.num_bytes, np.uint8)
        self.write(data)
        return EncodedCloud(**vars(self.layout), data=data)

    def write(self, data: npt.NDArray[np.uint8]) -> None:
        """Fills `layout.num_bytes` bytes, which must be 0."""
        if self.layout.num_points == 0:
            return
        pairs = self._pairs(data)
        num_rows, num_columns = pairs[0][0].shape if pairs else (0, 1)
        step = max(1, _BLOCK_POINTS // num_columns)
        for start in range(0, num_rows, step):
            for target, source in pairs:
                target[start : start + step] = source[start : start + step]

    def _pairs(
        self, data: npt.NDArray[np.uint8]
    ) -> list[tuple[npt.NDArray[Any], npt.NDArray[Any]]]:
        """Returns views into the data, each with its values of the same shape."""
        layout, kept = self.layout, self.kept
        pairs: list[tuple[npt.NDArray[Any], npt.NDArray[Any]]] = []
        shape = (layout.num_points, 1)
        if kept is not None and layout.height > 1:
            is_padded = kept.layout.row_step > layout.width * kept.layout.point_step
            shape = (layout.height, layout.width) if is_padded else shape
        if kept is not None and kept.size > 0:
            # One opaque element per point: the fastest copy, and no value is interpreted.
            element = np.dtype((np.void, kept.size))
            source = kept.layout.view(kept.data, element).reshape(shape)
            pairs.append((layout.view(data, element).reshape(shape), source))
        for field, column in self.columns:
            scalar = field.scalar.newbyteorder(">" if layout.is_bigendian else "<")
            target = layout.view(data, scalar, field.offset).reshape(shape)
            pairs.append((target, column.reshape(shape)))
        return pairs
