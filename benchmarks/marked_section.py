# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sections of a Markdown file that programs write, between two comments that name them."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path


def add_document_option(parser: ArgumentParser) -> None:
    """Adds `--document`, the file whose section a benchmark replaces."""
    parser.add_argument(
        "--document", type=Path, metavar="FILE", help="Markdown file with a section for the tables"
    )


def read_section(document: Path, name: str) -> str:
    """Returns what stands between `<!-- begin NAME -->` and `<!-- end NAME -->`.

    Raises:
        ValueError: As of `replace_section`.
    """
    return _parts(document, name)[1]


def replace_section(document: Path, name: str, text: str) -> None:
    """Replaces what stands between `<!-- begin NAME -->` and `<!-- end NAME -->`.

    Args:
        document: The Markdown file.
        name: Name of the section.
        text: The new content.

    Raises:
        ValueError: If the file does not have both comments, each once and in this order.
    """
    before, _, after = _parts(document, name)
    document.write_text(f"{before}{text.rstrip()}\n{after}", encoding="utf-8")


def _parts(document: Path, name: str) -> tuple[str, str, str]:
    """The file up to the section, the section, and the rest of the file."""
    begin, end = f"<!-- begin {name} -->\n", f"<!-- end {name} -->"
    before, found_begin, rest = document.read_text(encoding="utf-8").partition(begin)
    section, found_end, after = rest.partition(end)
    if not found_begin or not found_end or begin in after:
        raise ValueError(f"{document}: expected one section between '{begin.strip()}' and '{end}'")
    return before + begin, section, end + after
