# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf tune`: settings of the method online fitted to recordings."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mnsf_ros.cli.arguments import RESUME, Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import preset
from mnsf_ros.settings import parse_assignments

if TYPE_CHECKING:
    from mnsf_ros.evaluation.recordings import EvaluatedRecording
    from mnsf_ros.tuning.outcome import Outcome
    from mnsf_ros.tuning.tune import TuneOptions

_EPILOG = """\
Settings are chosen on the first half of each recording and judged on the second.

Goals:
  epe          three-way end point error; needs true flow
  consistency  without labels: points must land on a surface 0.3 s later

Files in DIR: tuned.yaml (a ROS parameter file with what changes), trials.log (all
trials, for --resume).
"""


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(
        subparsers,
        "tune",
        "find the best settings of the method online for recordings (Optuna)",
        _run,
        epilog=_EPILOG,
    )
    arguments.value("bags BAG", "recordings", Path, nargs="+")
    arguments.value("--out DIR", "folder for results", Path, default=Path("tuned"))
    arguments.flag("--resume", RESUME)
    arguments.value(
        "--goal NAME",
        "what to improve, see below (default: epe, or consistency without true flow)",
        choices=("epe", "consistency"),
    )
    arguments.value("--trials N", "number of trials in all", default=60)
    arguments.value("--minutes M", "end the search after M minutes (default: none)", float)
    arguments.value(
        "--parameters NAME,...",
        "parameters to tune (default: those listed in docs/parameters.md)",
    )
    arguments.assignments("set a parameter, which is then not tuned; may be repeated")
    arguments.value(
        "--max-examples N", "examples of each half of a recording; they stay in memory", default=40
    )
    arguments.value("--seed S", "seed of the search and of the points looked at", default=0)
    arguments.points()


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.evaluation.recordings import choose_topics, named_recordings
    from mnsf_ros.tuning.outcome import figures_table, write_parameters
    from mnsf_ros.tuning.tune import check_optuna

    check_optuna()
    console, tuning = Console(), _options(options)
    recordings = [
        choose_topics(path, name, options.points) for name, path in named_recordings(options.bags)
    ]
    outcome = _tuned(recordings, tuning, console)
    console.print(figures_table(outcome))
    for line in (*outcome.changes, outcome.verdict):
        console.say(line)
    if path := write_parameters(outcome, options.out, shlex.join(["mnsf", *sys.argv[1:]])):
        console.say(f"Written: {path}", soft_wrap=True)


def _options(options: argparse.Namespace) -> TuneOptions:
    from mnsf_ros.tuning.tune import TuneOptions

    start = preset("online").changed(parse_assignments(options.assignments))
    if start.method.name != "online":
        raise SettingsError(f"method.name: got {start.method.name!r}; only online can be tuned")
    names = (options.parameters or "").split(",")
    return TuneOptions(
        out=options.out,
        start=start,
        num_trials=options.trials,
        minutes=math.inf if options.minutes is None else options.minutes,
        names=tuple(filter(None, map(str.strip, names))),
        goal=options.goal,
        max_examples=options.max_examples,
        seed=options.seed,
        resume=options.resume,
    )


def _tuned(
    recordings: Sequence[EvaluatedRecording], tuning: TuneOptions, console: Console
) -> Outcome:
    """Tunes with a bar; on Ctrl-C names the way to continue."""
    from mnsf_ros.demo.console_progress import counting_progress
    from mnsf_ros.tuning.tune import tune

    try:
        with counting_progress(console) as progress:
            task = progress.add_task("trials", total=tuning.num_trials)

            def show(text: str, num_done: int, num_in_all: int) -> None:
                progress.update(task, description=text, completed=num_done, total=num_in_all)

            return tune(recordings, tuning, show)
    except KeyboardInterrupt:
        console.say(f"{tuning.out}: {RESUME}", soft_wrap=True)
        raise
