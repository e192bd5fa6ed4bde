# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf report`: the HTML report of an evaluation, written again from its rows."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import Subparsers, add_subcommand
from mnsf_ros.cli.console import Console

_EPILOG = """\
Pictures are those that `mnsf evaluate --pictures` has drawn: of the worst sweeps
of each method.
"""


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(
        subparsers,
        "report",
        "write the HTML report of an evaluation again, from its rows.jsonl",
        _run,
        epilog=_EPILOG,
    )
    arguments.value("folder", "folder of `mnsf evaluate --out`", Path)
    arguments.value("--pictures N", "number of worst sweeps shown in pictures", default=3)
    arguments.value("--method NAME", "method whose worst sweeps are shown (default: the first one)")


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.evaluation.run_folder import RunFolder
    from mnsf_ros.report.page import write_report
    from mnsf_ros.report.run_results import read_results

    folder = RunFolder(options.folder)
    results = read_results(folder, options.method)
    path = write_report(folder, results, max(0, options.pictures))
    console = Console()
    for note in results.notes:
        if note.is_incomplete:
            console.warn(note.text)
    console.say(f"Report: {path}")
