"""Sections of a Markdown file that programs write, between two comments that name them."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path


def add_document_option(parser: ArgumentParser) -> None:
    """Adds `--document`, the file whose section a benchmark replaces."""
    parser.add_argument(
        "--document", type=Path, metavar="FILE", help="Markdown file with a section for the tables"
    )


def replace_section(document: Path, name: str, text: str) -> None:
    """Replaces what stands between `<!-- begin NAME -->` and `<!-- end NAME -->`.

    Args:
        document: The Markdown file.
        name: Name of the section.
        text: The new content.

    Raises:
        ValueError: If the file does not have both comments, each once and in this order.
    """
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->"
    before, found_begin, rest = document.read_text(encoding="utf-8").partition(begin)
    _, found_end, after = rest.partition(end)
    if not found_begin or not found_end or begin in after:
        raise ValueError(f"{document}: expected one section between '{begin.strip()}' and '{end}'")
    document.write_text(f"{before}{begin}{text.rstrip()}\n{end}{after}", encoding="utf-8")
