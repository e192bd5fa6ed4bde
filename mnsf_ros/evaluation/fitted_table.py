"""A table on a terminal of any width: names and figures stay whole, columns go to further blocks.

Where there is little room, titles of columns and then names of rows go on in the next line after a
word; columns that find no room even so follow in further blocks, each with the names of the rows.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Final

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

# A line and a blank on each side of a cell; and the line at the right end.
_AROUND: Final = 3
_END: Final = 1

Block = list[tuple[int, int]]


@dataclass(frozen=True)
class FittedTable:
    """Finished cells for a `rich` console.

    Attributes:
        header: C column titles.
        rows: Rows of C cells, the first one their name.
        title: What the table shows; may be empty.
    """

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yields one table for each block of columns."""
        for number, block in enumerate(self._blocks(options.max_width - _END)):
            yield self._table(block, self.title if number == 0 else "")

    def _table(self, block: Block, title: str) -> Table:
        # Text, not str: rich would take a method called "[a]" for markup and swallow it.
        table = Table(title=Text(title) if title else None, title_justify="left")
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


def _room_of(block: Block) -> int:
    return sum(width + _AROUND for _, width in block)


def _word_width(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)
