# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A table of finished cells: for the terminal, as Markdown and as LaTeX."""

import math
import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import pandas as pd
from rich.console import Console, ConsoleOptions, RenderResult
from rich.text import Text

from mnsf_ros.errors import plain_text

NO_VALUE: Final = "-"


@dataclass(frozen=True)
class TextTable:
    """A table of finished cells. The first column names the row, the others hold numbers."""

    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    title: str = ""  # its caption

    @property
    def frame(self) -> pd.DataFrame:
        """The cells."""
        return pd.DataFrame([list(row) for row in self.rows], columns=list(self.header), dtype=str)

    @property
    def has_values(self) -> bool:
        """Whether a cell has a value, other than the names of rows."""
        return any(cell != NO_VALUE for row in self.rows for cell in row[1:])

    def markdown(self) -> str:
        """Returns the table as Markdown, the title as a paragraph above, newline at the end."""
        marks = [":---", *["---:"] * (len(self.header) - 1)]
        head, *rows = (
            [markdown_text(cell).replace("|", r"\|") for cell in row]
            for row in (self.header, *self.rows)
        )
        lines = [f"| {' | '.join(cells)} |" for cells in (head, marks, *rows)]
        title = [markdown_text(self.title), ""] if self.title else []
        return "\n".join([*title, *lines, ""])

    def latex(self) -> str:
        """Returns the table for LaTeX with the package booktabs, the title as caption."""
        return self.frame.map(_one_line).to_latex(
            index=False,
            escape=True,
            caption=re.sub(r"([&%$#_{}])", r"\\\1", self.title) or None,
            column_format="l" + "r" * (len(self.header) - 1),
        )

    def __rich_console__(self, console: Console, options: ConsoleOptions) -> RenderResult:
        """Yields title and table; columns beyond the width of the console follow in a block."""
        if self.title:
            yield Text(self.title, style="bold")
        frame = self.frame.iloc[:, 1:].set_axis([row[0] for row in self.rows])
        frame.columns.name = self.header[0]
        with pd.option_context("display.unicode.east_asian_width", True):
            text = frame.to_string(line_width=options.max_width)
        # Without pandas' marks of wrapped lines. Text, not str: rich would swallow a method called
        # "[a]" as markup.
        text = re.sub(r" +\\?$", "", text, flags=re.MULTILINE)
        yield Text(f"{text}\n", no_wrap=True, overflow="ignore")


def format_number(value: float, decimals: int) -> str:
    """Returns the number with fixed decimals, or a dash for NaN."""
    return NO_VALUE if math.isnan(value) else f"{value:.{decimals}f}"


def markdown_text(text: str) -> str:
    """Returns a text for Markdown, without HTML tags."""
    return _one_line(text).replace("&", "&amp;").replace("<", "&lt;")


def markdown_code(text: str) -> str:
    """Returns a text, possibly with backticks, as a span of code."""
    fence = "`" * (1 + max(map(len, re.findall("`+", text)), default=0))
    space = " " if len(fence) > 1 else ""
    return f"{fence}{space}{_one_line(text)}{space}{fence}"


def _one_line(text: str) -> str:
    return plain_text(" ".join(text.split()))
