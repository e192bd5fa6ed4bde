"""Numbers in text, one row a line, as PCD and PLY files have them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray


def parse_rows(text: bytes, num_rows: int, places: Sequence[int]) -> list[NDArray[Any]]:
    """Parses some columns of the first rows.

    Args:
        text: Rows, with blanks between the numbers.
        num_rows: Rows to parse.
        places: Columns wanted, counted from 0.

    Returns:
        The columns, (N,) float64 each.

    Raises:
        ValueError: If there are fewer rows, a row is too short, or something is no number.
    """
    lines = [line for line in text.splitlines() if not line.isspace() and line][:num_rows]
    if len(lines) < num_rows:
        raise ValueError(f"is cut short: {len(lines)} of {num_rows} rows")
    if not lines:
        return [np.zeros(0) for _ in places]
    return list(np.loadtxt(lines, usecols=tuple(places), ndmin=2, comments=None).T)
