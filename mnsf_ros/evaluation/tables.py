"""Tables for people, the same on the terminal and in Markdown, and those of a run."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from rich.cells import cell_len
from rich.console import Console, ConsoleOptions, RenderResult
from rich.table import Table
from rich.text import Text

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.argoverse_metrics import DYNAMIC, STATIC, THREE_WAY
from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.results import MethodSummary

# Chooses the best of the values of a column: `min` or `max`.
Better = Callable[[Iterable[float]], float]

_ERROR_COLUMNS: Final = ("EPE (m)", "Acc5 (%)", "Acc10 (%)", "Outliers (%)", "angle (rad)")
_ERROR_BETTER: Final[tuple[Better, ...]] = (min, max, max, min, min)
_TIME_COLUMN: Final = "time (ms)"
NO_VALUE: Final = "-"
# A line and a blank on each side of a cell; and the line at the right end.
_AROUND: Final = 3
_END: Final = 1

Block = list[tuple[int, int]]

_GROUP_TITLES: Final = {
    "all": "All points",
    "dynamic": "Dynamic points",
    "static": "Static points",
}


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

    def markdown(self) -> str:
        """Returns the table as Markdown, the title as a paragraph above, newline at the end."""
        alignments = [":---", *["---:"] * (len(self.header) - 1)]
        lines = [_markdown_row(self.header), _markdown_row(alignments)]
        lines += [_markdown_row(row) for row in self.rows]
        if self.title:
            lines = [self.title, "", *lines]
        return "\n".join(lines) + "\n"

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yields one table for each block of columns that finds room beside the names of rows.

        Figures stay whole. Where there is little room, titles of columns and then names of rows go
        on in the next line after a word; columns that find no room even so follow in further
        blocks.
        """
        for number, block in enumerate(self._blocks(options.max_width - _END)):
            yield self._drawn(block, self.title if number == 0 else "")

    def _drawn(self, block: Block, title: str) -> Table:
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


def errors_table(
    errors: Mapping[str, FlowErrors],
    *,
    title: str = "",
    row_title: str = "method",
    times_ms: Mapping[str, float] | None = None,
) -> TextTable:
    """Returns errors in the paper's column order, shares in percent.

    `times_ms` has the wall time of one estimate for each row; None leaves the column out, and a row
    that is missing, or NaN, gets a dash.
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
    return NO_VALUE if math.isnan(value) else f"{value:.{decimals}f}"


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


def _room_of(block: Block) -> int:
    return sum(width + _AROUND for _, width in block)


def _word_width(text: str) -> int:
    return max(map(cell_len, text.split()), default=0)


def _markdown_row(cells: Sequence[str]) -> str:
    escaped = (" ".join(cell.split()).replace("|", r"\|") for cell in cells)
    return "| " + " | ".join(escaped) + " |"


def main_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables that everybody wants to see, without those that would be empty."""
    consistency = consistency_table(summaries)
    return [*group_tables(summaries), *([] if consistency is None else [consistency])]


def group_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the errors of all, dynamic and static points, without tables that would be empty."""
    tables = [_group_table(summaries, group) for group in _GROUP_TITLES]
    return [table for table in tables if table is not None]


def further_tables(summaries: Sequence[MethodSummary]) -> list[TextTable]:
    """Returns the tables for those who look closer, without those that would be empty."""
    ranges = _bands_table(
        "EPE (m) by range (upper limit of each band)",
        {summary.method: summary.by_range for summary in summaries},
        "m",
    )
    speeds = _bands_table(
        "EPE (m) by true speed without ego motion (upper limit of each band)",
        {summary.method: summary.by_speed for summary in summaries},
        "m/s",
    )
    tables = [_three_way_table(summaries), _bucketed_table(summaries), ranges, speeds]
    return [table for table in [*tables, work_table(summaries)] if table is not None]


def consistency_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    """Returns the figures that need no truth; None if there are none."""
    if not any(summary.consistency for summary in summaries):
        return None
    columns = {
        "nearest_m": "nearest point, moved (m)",
        "zero_nearest_m": "nearest point, unmoved (m)",
        "cycle_m": "there and back (m)",
    }
    if all(math.isnan(summary.consistency.get("cycle_m", math.nan)) for summary in summaries):
        # Nobody has asked for it.
        del columns["cycle_m"]
    rows = [
        [
            summary.method,
            *(format_number(summary.consistency.get(key, math.nan), 3) for key in columns),
        ]
        for summary in summaries
    ]
    return TextTable(["method", *columns.values()], rows, "Self-consistency (needs no truth)")


def work_table(summaries: Sequence[MethodSummary]) -> TextTable:
    """Returns how many examples there were, what became of them and how long they took."""
    header = ["method", "flows", "failed", "dropped", "time (ms)", "latency (ms)"]
    better = [None, None, None, None, min, None, None, None]
    header += ["warm starts", "out of time"]
    rows = [
        [
            summary.method,
            *map(str, (summary.num_examples, summary.num_failed, summary.num_dropped)),
            format_number(summary.time_ms, 0),
            format_number(summary.latency_ms, 0),
            str(summary.starts.get("warm", 0)),
            str(summary.stop_reasons.get("time_budget", 0)),
        ]
        for summary in summaries
    ]
    title = "Examples (out of time: optimizations ended by their time budget)"
    return TextTable(header, rows, title, better)


def _group_table(summaries: Sequence[MethodSummary], group: str) -> TextTable | None:
    errors = {s.method: s.errors[group] for s in summaries if group in s.errors}
    num_scored = {name: item.num_points for name, item in errors.items()}
    if not any(num_scored.values()):
        return None
    least, most = min(num_scored.values()), max(num_scored.values())
    points = f"{most:,} points" if least == most else f"{least:,} to {most:,} points"
    title = f"{_GROUP_TITLES[group]} ({points})"
    if group != "all":
        return errors_table(errors, title=title)
    times_ms = {summary.method: summary.time_ms for summary in summaries}
    return errors_table(errors, title=title, times_ms=times_ms)


def _three_way_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    scored = [summary for summary in summaries if summary.three_way_epe_m]
    if not scored:
        return None
    names = (*THREE_WAY, "mean")
    rows = [
        [s.method, *(format_number(s.three_way_epe_m[name], 4) for name in names)] for s in scored
    ]
    title = "Three-way EPE (m) of Argoverse 2, over all points of all examples"
    return TextTable(["method", *names], rows, title, [None, *[min] * len(names)])


def _bucketed_table(summaries: Sequence[MethodSummary]) -> TextTable | None:
    classes = _in_order(summary.bucketed for summary in summaries)
    if not classes:
        return None
    columns = [(name, kind) for name in classes for kind in (DYNAMIC, STATIC)]
    header = ["method", *(f"{name} {kind}" for name, kind in columns)]
    rows = []
    for summary in summaries:
        values = [summary.bucketed.get(name, {}).get(kind, math.nan) for name, kind in columns]
        rows.append([summary.method, *(format_number(value, 3) for value in values)])
    title = (
        "Bucket-normalized error of Argoverse 2 within 35 m, over all points of all examples: "
        "dynamic (1: ego motion only) and static (m)"
    )
    return TextTable(header, rows, title, [None, *[min] * len(columns)])


def _bands_table(
    title: str, bands: Mapping[str, Mapping[str, FlowErrors]], unit: str
) -> TextTable | None:
    limits = sorted(_in_order(bands.values()), key=float)
    if not limits:
        return None
    header = ["method", *("farther" if x == "inf" else f"{x} {unit}" for x in limits)]
    if unit == "m/s":
        header = [column.replace("farther", "faster") for column in header]
    rows = [
        [method, *(format_number(errors[x].epe_m if x in errors else math.nan, 3) for x in limits)]
        for method, errors in bands.items()
    ]
    return TextTable(header, rows, title, [None, *[min] * len(limits)])


def _in_order(parts: Iterable[Mapping[str, object]]) -> list[str]:
    """All keys, in the order in which they come first; `mean` last."""
    names = list(dict.fromkeys(name for part in parts for name in part))
    return sorted(names, key=lambda name: name == "mean")
