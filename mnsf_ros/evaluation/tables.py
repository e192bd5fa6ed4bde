"""Tables for people: the same cells on the terminal and in Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.fitted_table import FittedTable
from mnsf_ros.evaluation.metrics import FlowErrors

# Chooses the best of the values of a column: `min` or `max`.
Better = Callable[[Iterable[float]], float]

_ERROR_COLUMNS: Final = ("EPE (m)", "Acc5 (%)", "Acc10 (%)", "Outliers (%)", "angle (rad)")
_ERROR_BETTER: Final[tuple[Better, ...]] = (min, max, max, min, min)
_TIME_COLUMN: Final = "time (ms)"
_NO_VALUE: Final = "-"


@dataclass(frozen=True)
class TextTable:
    """A table of finished cells. The first column names the row, the others hold numbers.

    Attributes:
        header: C column titles.
        rows: Rows of C cells.
        title: What the table shows; may be empty.
        better: For each column `min` or `max`, which chooses its best value, or None; may be empty.

    Raises:
        EvaluationError: If a row has not as many cells as the header.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""
    better: Sequence[Better | None] = ()

    def __post_init__(self) -> None:
        for number, row in enumerate(self.rows, start=1):
            if len(row) != len(self.header):
                raise EvaluationError(
                    f"row {number} of the table has {len(row)} cells {tuple(row)!r}, "
                    f"expected {len(self.header)}: {tuple(self.header)!r}"
                )

    def rich(self) -> FittedTable:
        """Returns the table for a `rich` console."""
        return FittedTable(self.header, self.rows, self.title)

    def markdown(self) -> str:
        """Returns the table as Markdown, the title as a paragraph above, newline at the end."""
        alignments = [":---", *["---:"] * (len(self.header) - 1)]
        lines = [_markdown_row(self.header), _markdown_row(alignments)]
        lines += [_markdown_row(row) for row in self.rows]
        if self.title:
            lines = [self.title, "", *lines]
        return "\n".join(lines) + "\n"


def errors_table(
    errors: Mapping[str, FlowErrors],
    *,
    title: str = "",
    row_title: str = "method",
    times_ms: Mapping[str, float] | None = None,
) -> TextTable:
    """Returns errors in the paper's column order, shares in percent.

    Args:
        errors: Name of the row, such as the method, to its errors.
        title: What the table shows; say there over what the values are means.
        row_title: Title of the first column.
        times_ms: Name of the row to wall time of one estimate. None leaves the column out; a
            row that is missing, or NaN, gets a dash.
    """
    header = [row_title, *_ERROR_COLUMNS]
    rows = [[name, *_error_cells(row_errors)] for name, row_errors in errors.items()]
    if times_ms is not None:
        header.append(_TIME_COLUMN)
        for row in rows:
            row.append(format_number(times_ms.get(row[0], math.nan), 0))
    better = (None, *_ERROR_BETTER, *([] if times_ms is None else [min]))
    return TextTable(header, rows, title, better)


def format_number(value: float, decimals: int) -> str:
    """Returns the number with so many decimals, or a dash for NaN."""
    return _NO_VALUE if math.isnan(value) else f"{value:.{decimals}f}"


def format_percent(share: float, decimals: int = 1) -> str:
    """Returns a share of 0 to 1 in percent, without the sign, or a dash for NaN."""
    return format_number(share * 100.0, decimals)


def _error_cells(errors: FlowErrors) -> list[str]:
    return [
        format_number(errors.epe_m, 3),
        format_percent(errors.acc5),
        format_percent(errors.acc10),
        format_percent(errors.outliers),
        format_number(errors.angle_error_rad, 3),
    ]


def _markdown_row(cells: Sequence[str]) -> str:
    escaped = (" ".join(cell.split()).replace("|", r"\|") for cell in cells)
    return "| " + " | ".join(escaped) + " |"
