# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Records with one row for each object in all of their fields."""

from dataclasses import fields, replace
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

_Own = TypeVar("_Own", bound="Rows")


class Rows:
    """Base of frozen dataclasses whose fields are arrays (K, ...) or such records themselves."""

    def take(self: _Own, rows: NDArray[np.int64]) -> _Own:
        """Returns the record of some of the objects, by their rows."""
        taken: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]
            column = getattr(self, field.name)
            taken[field.name] = column.take(rows) if isinstance(column, Rows) else column[rows]
        return replace(self, **taken)  # type: ignore[type-var]

    def put(self: _Own, rows: NDArray[np.int64], **columns: Any) -> _Own:  # noqa: ANN401
        """Returns the record with other values in some rows of these columns."""
        changed: dict[str, Any] = {}
        for name, values in columns.items():
            column = getattr(self, name)
            if isinstance(column, Rows):
                own = {field.name: getattr(values, field.name) for field in fields(values)}
                changed[name] = column.put(rows, **own)
            else:
                changed[name] = column.copy()
                changed[name][rows] = values
        return replace(self, **changed)  # type: ignore[type-var]
