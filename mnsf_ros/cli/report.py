"""`mnsf report`: the HTML report of an evaluation, written again from its rows."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import Subparsers, add_subcommand
from mnsf_ros.cli.console import Console

_EPILOG = """\
Pictures show the flow that `mnsf evaluate --write-flow` has stored. Without it,
the worst sweeps and the sweeps of missed movers are estimated again, by methods
that remember earlier sweeps after up to 30 before. Where that is another flow than
that of the run, as it may be in real time, the caption says so.
"""


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(
        subparsers,
        "report",
        "write the HTML report of an evaluation again",
        _run,
        description="Write report.html into the folder of an evaluation, from its rows.jsonl.",
        epilog=_EPILOG,
    )
    arguments.value("folder", "what `mnsf evaluate --out` has written", Path)
    arguments.value("--pictures N", "number of worst sweeps shown in pictures", default=3)
    arguments.value("--method NAME", "whose worst sweeps (default: the first method)")
    arguments.flag("--no-estimate", "no new estimates for pictures")


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.evaluation.run_folder import RunFolder
    from mnsf_ros.report.run_report import report_run
    from mnsf_ros.report.run_results import read_results

    console = Console()
    path = report_run(
        read_results(RunFolder(options.folder)),
        options.folder,
        num_pictured=max(0, options.pictures),
        estimate_again=not options.no_estimate,
        focus=options.method,
        say=console.say,
    )
    console.say(f"Report: {path}")
