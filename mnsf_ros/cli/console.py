# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The console of all subcommands."""

import logging
import sys
from collections.abc import Iterable

import rich.console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn
from rich.segment import Segment

from mnsf_ros.errors import plain_text


class Console(rich.console.Console):
    """Shows control characters in names and messages instead of sending them to the terminal."""

    def render(
        self,
        renderable: rich.console.RenderableType,
        options: rich.console.ConsoleOptions | None = None,
    ) -> Iterable[Segment]:
        """Yields the segments of all that is printed, also of tables and bars."""
        for segment in super().render(renderable, options):
            lines = segment.text.split("\n")
            safe = segment._replace(text="\n".join(map(plain_text, lines)))
            yield segment if segment.control else safe

    def say(self, text: str, style: str | None = None) -> None:
        """Prints a text without markup; long lines stay whole."""
        self.print(text, style=style, markup=False, highlight=False, soft_wrap=True)

    def warn(self, text: str) -> None:
        """Prints a text that needs attention."""
        self.say(text, "yellow")


def counting_progress(console: Console) -> Progress:
    """A bar with a text, `done/all` and the time left; add a task with its total to it."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeRemainingColumn(), console=console)


class _PlainLines(logging.Formatter):
    def format(self, record: logging.LogRecord) -> str:
        return "\n".join(map(plain_text, super().format(record).split("\n")))


def show_warnings() -> None:
    """Prints warnings of all libraries on standard error, without control characters."""
    handler = logging.StreamHandler()
    handler.setFormatter(_PlainLines())
    logging.getLogger().addHandler(handler)


def complain(text: object) -> None:
    """Prints an error of the command as one line."""
    print(f"mnsf: {plain_text(text)}", file=sys.stderr)
