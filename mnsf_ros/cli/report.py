"""`mnsf report`: the HTML report of an evaluation, written again from its rows."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

_EPILOG = """\
Pictures are drawn from the flow that `mnsf evaluate --write-flow` has kept; where there is none,
the worst examples are estimated once more, each from its sweeps alone. That gives the same flow,
unless the method went on from one example to the next, as with warm start: then the caption tells.
"""


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser(
        "report",
        help="write the HTML report of an evaluation again",
        description="Writes report.html into the folder of an evaluation, from its rows.jsonl.",
        epilog=_EPILOG,
    )
    parser.add_argument("folder", type=Path, help="what `mnsf evaluate --out` has written")
    parser.add_argument(
        "--pictures",
        type=int,
        default=3,
        metavar="N",
        help="show so many of the worst examples in pictures (default 3)",
    )
    parser.add_argument("--method", metavar="NAME", help="whose worst examples (default: mnsf)")
    parser.add_argument(
        "--no-estimate",
        action="store_true",
        help="do not estimate anything again for pictures",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.report.run_report import report_run

    console = Console()
    path = report_run(
        options.folder,
        num_pictured=max(0, options.pictures),
        estimate_again=not options.no_estimate,
        focus=options.method,
        say=lambda text: console.print(text, markup=False, highlight=False),
    )
    console.print(f"Report: {path}", markup=False, highlight=False)
