"""Measures a promise of docs/reliability.md: `python benchmarks/reliability.py PROMISE`."""

from __future__ import annotations

import argparse
import os

import reliability_ends
import reliability_live
from rich.console import Console
from rich.table import Table

_PROMISES = {**reliability_live.PROMISES, **reliability_ends.PROMISES}
# The length or number that the promise is about.
_HOURS = {"soak": 24.0, "overload": 1.0}
_NUMBERS = {"clouds": 10_000, "parameters": 5_000, "kills": 100, "signals": 200, "disk": 20}


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    promises = parser.add_subparsers(dest="promise", required=True, metavar="PROMISE")
    for name, measure in _PROMISES.items():
        promise = promises.add_parser(name, help=measure.__doc__.splitlines()[0])
        if name in _HOURS:
            promise.add_argument("--hours", type=float, default=_HOURS[name])
        if name in _NUMBERS:
            promise.add_argument("--number", type=int, default=_NUMBERS[name])
            promise.add_argument("--seed", type=int, default=0)
        if name == "parameters":
            promise.add_argument("--minutes", type=float, default=600, help="stop after them")
        if name == "clouds":
            promise.add_argument("--pause-ms", type=float, default=20, help="after each pair")
    return parser.parse_args()


def main() -> None:
    """Measures, prints a table, and ends with status 1 if the promise does not hold."""
    options = _options()
    # Nothing of this goes beyond the machine; ROS_DOMAIN_ID keeps it apart from other nodes.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    table = Table("", "measured", "", title=f"{options.promise}, {os.cpu_count()} cores")
    is_held = True
    for name, text, is_met in _PROMISES[options.promise](options):
        table.add_row(name, text, "met" if is_met else "MISSED")
        is_held = is_held and is_met
    Console(width=140).print(table)
    raise SystemExit(0 if is_held else 1)


if __name__ == "__main__":
    main()
