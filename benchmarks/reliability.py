# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Measures promises of docs/reliability.md: `python benchmarks/reliability.py PROMISE`.

Each is tried in rounds. The table has a line for each figure; a document gets a row for each
promise. Ctrl-C ends the promise under way after its round. Use a ROS_DOMAIN_ID of its own.
"""

from __future__ import annotations

import argparse
import datetime
import os
import signal
from collections.abc import Sequence
from pathlib import Path

import mutated_bags
import reliability_ends
import reliability_live
import reliability_parameters
from marked_section import add_document_option, read_section, replace_section
from promises import Figure, Promise, Rounds
from rich.console import Console
from rich.table import Table

# What takes longest comes last: `all` gives the time that a promise leaves to those that follow.
PROMISES = {
    **reliability_ends.PROMISES,
    **mutated_bags.PROMISES,
    **reliability_parameters.PROMISES,
    **reliability_live.PROMISES,
}
_SECTION = "reliability"
_HEAD = "| promise | command | measured | when | |\n|---|---|---|---|---|\n"


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("promise", choices=[*PROMISES, "all"])
    parser.add_argument("--number", type=int, help="rounds (default: what the promise is about)")
    parser.add_argument("--first", type=int, default=0, help="number of the first round")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--minutes", type=float, default=2880, help="for all promises together")
    add_document_option(parser)
    return parser.parse_args()


def main() -> None:
    """Measures, prints tables, and ends with status 1 if a promise does not hold."""
    options = _options()
    # Nothing of this goes beyond the machine; ROS_DOMAIN_ID keeps it apart from other nodes.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    names = list(PROMISES) if options.promise == "all" else [options.promise]
    are_held, minutes = True, options.minutes
    for index, name in enumerate(names):
        promise, start = PROMISES[name], datetime.datetime.now(tz=datetime.timezone.utc)
        number = options.number or promise.number - options.first
        rounds = Rounds(number, minutes / (len(names) - index), options.first, options.seed)
        signal.signal(signal.SIGINT, lambda *_, rounds=rounds: rounds.stop())
        figures = list(promise.measure(rounds))
        took_min = (datetime.datetime.now(tz=datetime.timezone.utc) - start).total_seconds() / 60
        minutes -= took_min
        done = f"{rounds.done:,} of {promise.number:,} {promise.unit} in {took_min:.0f} min"
        done += f", from number {options.first:,}" if options.first else ""
        verdict = _verdict(promise, rounds, figures)
        _show(name, done, figures, verdict)
        if options.document:
            when = f"{start:%Y-%m-%d}, {os.cpu_count()} cores"
            _write_row(options.document, name, done, figures, when, verdict)
        are_held = are_held and verdict != "MISSED"
    raise SystemExit(0 if are_held else 1)


def _verdict(promise: Promise, rounds: Rounds, figures: Sequence[Figure]) -> str:
    if not all(is_met for _, _, is_met in figures):
        return "MISSED"
    return "met" if rounds.done >= promise.number else "in part"


def _show(name: str, done: str, figures: Sequence[Figure], verdict: str) -> None:
    table = Table("", "measured", "", title=f"{name}: {done}: {verdict}")
    for what, text, is_met in figures:
        table.add_row(what, text, "" if is_met else "MISSED")
    Console(width=140).print(table, markup=False)


def _write_row(
    document: Path, name: str, done: str, figures: Sequence[Figure], when: str, verdict: str
) -> None:
    """Replaces the row of a promise, or adds it."""
    texts = [f"{what}: {text}" + ("" if is_met else " (MISSED)") for what, text, is_met in figures]
    measured = "; ".join([done, *texts]).replace("|", "\\|").replace("\n", " ")
    rows = {}
    for row in read_section(document, _SECTION).splitlines()[2:]:
        rows[row.split(" | ")[1].strip("`")] = row
    rows[name] = f"| {PROMISES[name].text} | `{name}` | {measured} | {when} | {verdict} |"
    text = "\n".join(rows[known] for known in PROMISES if known in rows)
    replace_section(document, _SECTION, _HEAD + text)


if __name__ == "__main__":
    main()
