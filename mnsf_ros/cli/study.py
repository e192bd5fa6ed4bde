# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf study`: the paper's ablation tables and case studies."""

import argparse
import sys
from pathlib import Path

from mnsf_ros.cli.arguments import RESUME, Arguments, chosen, chosen_settings
from mnsf_ros.cli.console import Console
from mnsf_ros.cli.evaluate import status_of
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.studies.settings import STUDIES, CaseStudySettings

_EPILOG = "\n".join(
    [
        "Studies:",
        *(f"  {name:<10} {text}" for name, (_, text) in STUDIES.items()),
        "",
        "Exit status: 0: done; 5: a recording is damaged, its readable part was used.",
    ]
)


def add_study(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.value("name NAME", "study, see below", choices=STUDIES)
    arguments.existing("bags BAG", "recordings", nargs="+")
    arguments.value("--out DIR", "folder for results (default: study_NAME)", Path)
    arguments.flag("--resume", RESUME)
    arguments.settings()
    names = ("num_points", "max_examples", "seed")
    arguments.declared(EvaluationOptions, *names, num_points=2048)
    case = arguments.group(
        "landscape and stability, which use the first example; warm-start, the first recording"
    )
    case.declared(CaseStudySettings)
    return _EPILOG


def run_study(options: argparse.Namespace) -> int:
    """Runs a study, and prints its tables; returns the exit status."""
    from mnsf_ros.studies.study import StudyOptions
    from mnsf_ros.studies.study import run_study as run

    console = Console()
    study = StudyOptions(
        out=options.out or Path(f"study_{options.name}"),
        evaluation=chosen(options, EvaluationOptions, settings=chosen_settings(options)),
        recordings=chosen_recordings(options.bags),
        resume=options.resume,
        command=("mnsf", *sys.argv[1:]),
        say=console.say,
        case=chosen(options, CaseStudySettings),
    )
    result, paths = run(options.name, study)
    for table in result.tables:
        console.print(table)
    for text in (*result.texts, f"Written: {', '.join(map(str, paths))}"):
        console.say(text)
    return status_of(study.recordings)
