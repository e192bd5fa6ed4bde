# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The frame of all benchmarks: options, tables, verdicts, and the page with the results."""

import argparse
import datetime
import math
import os
import platform
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from rich.console import Console
from rich.markdown import Markdown


@dataclass(frozen=True)
class Table:
    """A table of finished cells.

    Attributes:
        title: What it shows.
        header: C column titles.
        rows: Rows of C cells.
        is_detail: Printed, but not written into the page with the results.
    """

    title: str
    header: Sequence[str]
    rows: Sequence[Sequence[str]]
    is_detail: bool = False

    def markdown(self) -> str:
        """The table as Markdown; the first column is text, the others are numbers."""
        marks = [":---", *["---:"] * (len(self.header) - 1)]
        lines = [f"| {' | '.join(cells)} |" for cells in (self.header, marks, *self.rows)]
        return "\n".join([f"{self.title}\n", *lines, ""])


@dataclass(frozen=True)
class Target:
    """A measured figure with a limit.

    Attributes:
        name: Name of the figure, with its unit.
        limit: Largest good value, or smallest.
        measured: The figure; NaN if there is nothing to judge.
        is_minimum: Whether more is better.
        text: How the figure is printed; empty for its number.
    """

    name: str
    limit: float
    measured: float
    is_minimum: bool = False
    text: str = ""

    @property
    def verdict(self) -> str:
        """`met`, `MISSED`, or empty if there is nothing to judge."""
        if math.isnan(self.measured):
            return ""
        is_met = self.measured >= self.limit if self.is_minimum else self.measured <= self.limit
        return "met" if is_met else "MISSED"

    def row(self) -> list[str]:
        """Cells for `TARGET_HEADER`."""
        bound = "at least" if self.is_minimum else "at most"
        return [
            self.name,
            f"{bound} {self.limit:g}",
            self.text or f"{self.measured:.3g}",
            self.verdict,
        ]


TARGET_HEADER: Final = ("", "target", "measured", "")


def make_parser(text: str | None, *, has_document: bool = True) -> argparse.ArgumentParser:
    """Returns a parser with a help text of several lines, and the option `--document`."""
    parser = argparse.ArgumentParser(
        description=text, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    if has_document:
        parser.add_argument(
            "--document", type=Path, metavar="FILE", help="write results into its marked section"
        )
    return parser


def publish(section: str, tables: Iterable[Table], document: Path | None) -> None:
    """Prints tables as they get ready, then writes those that are no details into a document."""
    texts = []
    for table in tables:
        show(table.markdown())
        if not table.is_detail:
            texts.append(table.markdown())
    if document:
        replace_section(document, section, f"{this_machine()}. " + "\n".join(texts))


def show(text: str) -> None:
    """Prints Markdown."""
    Console(width=150).print(Markdown(text), "")


def replace_section(document: Path, name: str, text: str) -> None:
    """Replaces the text between `<!-- begin NAME -->` and `<!-- end NAME -->`.

    Raises:
        ValueError: If the file does not have one such section.
    """
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->"
    before, *rest = document.read_text(encoding="utf-8").split(begin)
    if len(rest) != 1 or rest[0].count(end) != 1:
        raise ValueError(f"{document}: expected one section between '{begin.strip()}' and '{end}'")
    after = rest[0].partition(end)[2]
    document.write_text(f"{before}{begin}{text.rstrip()}\n{end}{after}", encoding="utf-8")


def this_machine() -> str:
    """Processor, number of cores and date, in one line."""
    info = Path("/proc/cpuinfo")
    lines = info.read_text().splitlines() if info.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    today = datetime.datetime.now(tz=datetime.timezone.utc)
    return f"{[*names, platform.machine()][0]}, {os.cpu_count()} cores, {today:%Y-%m-%d}"
