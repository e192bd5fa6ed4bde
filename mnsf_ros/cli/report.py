"""`mnsf report`: the HTML report of an evaluation, written again from its rows."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

_EPILOG = """\
Pictures show the flow that `mnsf evaluate --write-flow` has stored. Without it, the worst sweeps
are estimated again, each from its sweeps alone. The flow is the same, unless the method continued
from its last estimate, as with warm start: see the captions.
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
        help="number of worst sweeps shown in pictures (default 3)",
    )
    parser.add_argument(
        "--method", metavar="NAME", help="whose worst sweeps (default: the first method)"
    )
    parser.add_argument(
        "--no-estimate",
        action="store_true",
        help="no new estimates for pictures",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.evaluation.results_files import read_results
    from mnsf_ros.evaluation.run_folder import RunFolder
    from mnsf_ros.report.run_report import report_run

    console = Console()
    path = report_run(
        read_results(RunFolder(options.folder)),
        options.folder,
        num_pictured=max(0, options.pictures),
        estimate_again=not options.no_estimate,
        focus=options.method,
        say=lambda text: console.print(text, markup=False, highlight=False),
    )
    console.print(f"Report: {path}", markup=False, highlight=False)
