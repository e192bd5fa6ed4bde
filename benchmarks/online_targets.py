# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The online method against its targets: speed, accuracy, memory, reproducibility.

    python benchmarks/online_targets.py [--parts accuracy resources cost live] [--document FILE]

Each part has a section of its own in the document.

Everything is measured in this one run: live latency with the real node over DDS, errors beside the
project's own faithful FNSF and MNSF (preset `paper`) and beside ego motion alone, on the recordings
beside the checkout (or where the environment variable MNSF_DATA says) and on simulated streets.
Targets are those of the project; a figure that misses one is printed as missed. The machine should
have nothing else to do.
"""

from __future__ import annotations

import argparse
import datetime
import os
import platform
from collections.abc import Iterator
from pathlib import Path

# Before torch is loaded; the node does the same.
os.environ.setdefault("OMP_WAIT_POLICY", "PASSIVE")

from marked_section import add_document_option, replace_section
from online_accuracy import accuracy_tables
from online_cost import cost_tables
from online_live import live_tables
from online_resources import resource_tables
from rich.console import Console

PARTS = {
    "accuracy": accuracy_tables,
    "resources": resource_tables,
    "cost": cost_tables,
    "live": live_tables,
}


def main() -> None:
    """Measures the parts asked for and prints their tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--parts", nargs="+", choices=PARTS, default=list(PARTS))
    parser.add_argument("--quick", action="store_true", help="a tenth of the work, to try it out")
    add_document_option(parser)
    options = parser.parse_args()
    console = Console(width=120)
    for part in options.parts:
        texts = [_head()]
        for table in PARTS[part](quick=options.quick):
            console.print(table)
            texts.append(f"{table.markdown()}\n")
        if options.document:
            replace_section(options.document, section_of(part), "\n".join(texts))


def section_of(part: str) -> str:
    """Returns the name of the section that a part writes."""
    return f"online {part}"


def _head() -> str:
    today = datetime.datetime.now(tz=datetime.timezone.utc)
    return f"{_processor()}, {os.cpu_count()} cores, no GPU used, {today:%Y-%m-%d}.\n"


def _processor() -> str:
    lines: Iterator[str] = iter(())
    if Path("/proc/cpuinfo").exists():
        lines = iter(Path("/proc/cpuinfo").read_text().splitlines())
    names = (line.partition(":")[2].strip() for line in lines if line.startswith("model name"))
    return next(names, platform.processor() or platform.machine())


if __name__ == "__main__":
    main()
