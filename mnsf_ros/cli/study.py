# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf study`: the paper's ablation tables and case studies."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from mnsf_ros.cli.arguments import (
    ALL,
    RESUME,
    Arguments,
    chosen,
    chosen_settings,
    number_or_all,
)
from mnsf_ros.cli.console import Console
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.studies.study import CaseStudySettings, StudyOptions

_NAMES = {
    "ablation": "FNSF, and MNSF without single parts: (a) to (d) of the paper",
    "fusion": "fusion by mean, by weighted sum and by a network",
    "depth": "fusion network with 2, 3, 5 and 7 layers",
    "frames": "2, 3, 4 and 5 sweeps",
    "landscape": "loss around the optimum, FNSF and MNSF",
    "stability": "effect of replacing one point of N, expected to fall with 1/N",
}
_EPILOG = "Studies:\n" + "\n".join(f"  {name:<10} {text}" for name, text in _NAMES.items())


def add_study(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.value("name NAME", "study, see below", choices=_NAMES)
    arguments.recordings("bags BAG", "recordings (default: a simulated street)", nargs="*")
    arguments.value("--out DIR", "folder for results (default: study_NAME)", Path)
    arguments.flag("--resume", RESUME)
    arguments.settings()
    arguments.value(
        "--num-points N",
        "use N random points of each sweep, or all (default: 2048; stability: all)",
        number_or_all,
    )
    arguments.value(
        "--max-examples N",
        "use the first N examples of each recording (default: all; 4 of a simulated street); "
        "landscape and stability use the first one",
        int,
    )
    arguments.value("--seed S", "seed of everything random", default=0)
    arguments.group("case studies").declared(CaseStudySettings)
    return _EPILOG


def run_study(options: argparse.Namespace) -> None:
    """Runs a study, and prints its tables."""
    # It needs PyTorch, the help does not.
    from mnsf_ros.studies import run_study as studies

    console = Console()
    num_points = options.num_points
    if num_points is None:
        # Stability draws its own numbers of points from all.
        num_points = ALL if options.name == "stability" else 2048
    study = StudyOptions(
        out=options.out or Path(f"study_{options.name}"),
        evaluation=EvaluationOptions(
            chosen_settings(options),
            num_points=None if num_points == ALL else num_points,
            seed=options.seed,
            max_examples=options.max_examples,
        ),
        recordings=tuple(options.bags),
        resume=options.resume,
        command=("mnsf", *sys.argv[1:]),
        say=console.say,
        case=chosen(options, CaseStudySettings),
    )
    result, paths = studies.run_study(options.name, study)
    for table in result.tables:
        console.print(table)
    for text in (*result.texts, f"Written: {', '.join(map(str, paths))}"):
        console.say(text)
