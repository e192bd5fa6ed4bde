# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A table of finished cells, the same on the terminal and in Markdown."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Any, Final, NamedTuple

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table as RichTable
from rich.text import Text

from mnsf_ros.errors import EvaluationError

# Chooses the best of the values of a column: `min` or `max`.
Better = Callable[[Iterable[float]], float]

NO_VALUE: Final = "-"
_LATEX: Final = {
    **{sign: f"\\{sign}" for sign in "&%$#_{}"},
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
    "\N{EN DASH}": "--",
}
# A line and a blank on each side of a cell; and the line at the right end.
_AROUND: Final = 3
_END: Final = 1

Block = list[tuple[int, int]]


@dataclass(frozen=True)
class TextTable:
    """A table of finished cells, for a `rich` console of any width and as Markdown.

    The first column names the row, the others hold numbers.

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

    def best_cells(self, references: Iterable[str]) -> set[tuple[int, int]]:
        """Returns row and column of the best values: of columns that have one, if rows compete.

        Rows of references only show what an error is worth, and never are the best.
        """
        best = set()
        for column, better in enumerate(self.better):
            values = {
                place: float(row[column])
                for place, row in enumerate(self.rows)
                if better and row[0] not in references and _has_value(row[column])
            }
            if better and len(set(values.values())) > 1:
                best_value = better(values.values())
                best |= {(place, column) for place, value in values.items() if value == best_value}
        return best

    def markdown(self) -> str:
        """Returns the table as Markdown, the title as a paragraph above, newline at the end."""
        alignments = [":---", *["---:"] * (len(self.header) - 1)]
        lines = [_markdown_row(self.header), _markdown_row(alignments)]
        lines += [_markdown_row(row) for row in self.rows]
        if self.title:
            lines = [self.title, "", *lines]
        return "\n".join(lines) + "\n"

    def latex(self) -> str:
        """Returns the table for LaTeX with the package booktabs, the title as caption."""
        columns = "l" + "r" * (len(self.header) - 1)
        caption = [rf"\caption{{{_latex_text(self.title)}}}"] if self.title else []
        lines = [r"\begin{table}", *caption, rf"\begin{{tabular}}{{{columns}}}", r"\toprule"]
        lines += [_latex_row(self.header), r"\midrule", *map(_latex_row, self.rows)]
        lines += [r"\bottomrule", r"\end{tabular}", r"\end{table}"]
        return "\n".join(lines) + "\n"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yields one table for each block of columns that finds room beside the names of rows.

        Figures stay whole. Where there is little room, titles of columns and then names of rows go
        on in the next line after a word; columns that find no room even so follow in further
        blocks.
        """
        for number, block in enumerate(self._blocks(options.max_width - _END)):
            more = " (continued)" if number and self.title else ""
            yield self._drawn(block, f"{self.title}{more}")

    def _drawn(self, block: Block, title: str) -> RichTable:
        # Text, not str: rich would take a method called "[a]" for markup and swallow it.
        table = RichTable(title=Text(title) if title else None, title_justify="left")
        for place, width in block:
            table.add_column(
                Text(self.header[place]),
                justify="right" if place else "left",
                width=width,
                overflow="fold",
            )
        for row in self.rows:
            table.add_row(*(Text(row[place]) for place, _ in block))
        return table

    def _blocks(self, room: int) -> Iterator[Block]:
        """Yields places and widths of the columns of each block, the names first."""
        least = [self._width(place, title_breaks=True) for place in range(len(self.header))]
        words = max(map(_word_width, [self.header[0], *(row[0] for row in self.rows)]))
        # Beside a name that is too long for that, the widest column must still have its place.
        least[0] = max(1, min(words, room - _AROUND - max(least[1:], default=-_AROUND) - _AROUND))
        block = [(0, least[0])]
        for place, width in enumerate(least[1:], start=1):
            if len(block) > 1 and _room_of(block) + width + _AROUND > room:
                yield self._grown(block, room)
                block = [(0, least[0])]
            block.append((place, width))
        yield self._grown(block, room)

    def _grown(self, block: Block, room: int) -> Block:
        """The block with what room is left given to the names, then to the titles."""
        widths = dict(block)
        lacking = {place: self._width(place) - width for place, width in block}
        for _ in range(room - _room_of(block)):
            place = 0 if lacking[0] > 0 else max(lacking, key=lambda place: lacking[place])
            if lacking[place] <= 0:
                break
            widths[place] += 1
            lacking[place] -= 1
        return list(widths.items())

    def _width(self, place: int, *, title_breaks: bool = False) -> int:
        """Width of a column, its title in one line or with breaks between words."""
        title = self.header[place]
        title_width = _word_width(title) if title_breaks else cell_len(title)
        return max([title_width, *(cell_len(row[place]) for row in self.rows)])


class Column(NamedTuple):
    """A column of a table.

    Attributes:
        title: What it shows, with unit.
        cell: Makes the cell of a row from what the row shows.
        better: Chooses its best value; None if there is none.
        is_optional: Whether it is left out where no row has a value.
    """

    title: str
    cell: Callable[[Any], str]
    better: Better | None = None
    is_optional: bool = False


class Table(NamedTuple):
    """A table whose cells are still to be made.

    Attributes:
        title: What it shows.
        rows: The name of each row, and what columns make its cells of.
        columns: All but that of the names.
        row_title: What the names are.
        says_enough: Whether its title is worth a table in which nothing has a value.
    """

    title: str
    rows: Sequence[tuple[str, Any]]
    columns: Sequence[Column]
    row_title: str = "method"
    says_enough: bool = False


def made_tables(tables: Iterable[Table]) -> list[TextTable]:
    """Makes the cells of tables; those that say nothing are left out."""
    made = [(table, made_table(table)) for table in tables]
    return [one for table, one in made if table.says_enough or _has_values(one)]


def _has_values(table: TextTable) -> bool:
    return any(_has_value(cell) for row in table.rows for cell in row[1:])


def made_table(table: Table) -> TextTable:
    """Makes the cells of a table."""
    cells = [[column.cell(row) for _, row in table.rows] for column in table.columns]
    kept = [
        (column, own)
        for column, own in zip(table.columns, cells, strict=True)
        if not column.is_optional or any(map(_has_value, own))
    ]
    return TextTable(
        header=[table.row_title, *(column.title for column, _ in kept)],
        rows=[
            [name, *(own[number] for _, own in kept)] for number, (name, _) in enumerate(table.rows)
        ],
        title=table.title,
        better=[None, *(column.better for column, _ in kept)],
    )


def _has_value(cell: str) -> bool:
    return cell != NO_VALUE


def format_number(value: float, decimals: int) -> str:
    """Returns the number with so many decimals, or a dash for NaN."""
    return NO_VALUE if math.isnan(value) else f"{value:.{decimals}f}"


def format_percent(share: float, decimals: int = 1) -> str:
    """Returns a share of 0 to 1 in percent, without the sign, or a dash for NaN."""
    return format_number(share * 100.0, decimals)


def _room_of(block: Block) -> int:
    return sum(width + _AROUND for _, width in block)


def _word_width(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)


def _latex_row(cells: Sequence[str]) -> str:
    return " & ".join(map(_latex_text, cells)) + r" \\"


def _latex_text(text: str) -> str:
    return "".join(_LATEX.get(sign, sign) for sign in " ".join(text.split()))


def _markdown_row(cells: Sequence[str]) -> str:
    escaped = (" ".join(cell.split()).replace("|", r"\|") for cell in cells)
    return "| " + " | ".join(escaped) + " |"
