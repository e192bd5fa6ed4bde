# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf tune`: the best settings of the method online for some recordings."""

from __future__ import annotations

import argparse
import math
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mnsf_ros.cli.arguments import Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import preset
from mnsf_ros.settings import parse_assignments

if TYPE_CHECKING:
    from mnsf_ros.evaluation.recordings import EvaluatedRecording
    from mnsf_ros.tuning.outcome import Found
    from mnsf_ros.tuning.tune import TuneOptions

_EPILOG = """\
Settings are chosen on the first half of each recording and judged on the second.

Goals:
  epe          three-way end point error; needs true flow
  iou          share of dynamic points that are found, and of others that are
               called dynamic; needs true flow
  consistency  without labels: points must land on a surface 0.3 s later

Files in DIR: tuned.yaml (a ROS parameter file with what changes), tuning.md,
trials.log (all trials; --resume goes on with them).
"""


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(
        subparsers,
        "tune",
        "find the best settings of the method online for recordings",
        _run,
        description="Find the parameters of the method online that are best on recordings, by "
        "many trials (Optuna).",
        epilog=_EPILOG,
    )
    arguments.value("bags BAG", "recordings", Path, nargs="+")
    arguments.value("--out DIR", "folder for results", Path, default=Path("tuned"))
    arguments.flag("--resume", "go on with the trials in DIR: repeat the command and add --resume")
    arguments.value(
        "--goal NAME",
        "what to improve, see below (default: epe, or consistency without true flow)",
        choices=("epe", "iou", "consistency"),
    )
    arguments.value("--trials N", "number of trials in all", default=60)
    arguments.value("--minutes M", "end the search after M minutes (default: none)", float)
    arguments.value(
        "--parameters NAME,...",
        "parameters to tune (default: those listed in docs/tuning.md, By trials)",
    )
    arguments.assignments("set a parameter, which is then not tuned; may be repeated")
    arguments.value(
        "--max-examples N", "examples of each half of a recording; they stay in memory", default=40
    )
    arguments.value("--seed S", "seed of the search and of the points looked at", default=0)
    arguments.value("--points TOPIC", "point clouds (needed only if there are several topics)")


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.demo.console_progress import counting_progress
    from mnsf_ros.evaluation.recordings import choose_topics, recording_names
    from mnsf_ros.recording.inspection import inspect_recording
    from mnsf_ros.tuning.outcome import (
        concluded,
        figures_table,
        gains_table,
        write_best,
        write_outcome,
    )
    from mnsf_ros.tuning.search import Budget
    from mnsf_ros.tuning.tune import TuneOptions

    console = Console()
    command = shlex.join(["mnsf", *sys.argv[1:]])
    start = preset("online").changed(parse_assignments(options.assignments))
    if start.method.name != "online":
        raise SettingsError(f"method.name: got {start.method.name!r}; only online can be tuned")
    names = (options.parameters or "").split(",")
    tuning = TuneOptions(
        out=options.out,
        start=start,
        budget=Budget(options.trials, math.inf if options.minutes is None else options.minutes),
        names=tuple(filter(None, map(str.strip, names))),
        goal=options.goal,
        max_examples=options.max_examples,
        seed=options.seed,
        resume=options.resume,
    )
    recordings = [
        choose_topics(inspect_recording(path), name, options.points)
        for path, name in zip(options.bags, recording_names(options.bags), strict=True)
    ]
    found = _searched(recordings, tuning, console)
    write_best(found, options.out, command)
    with counting_progress(console) as progress:
        task = progress.add_task("judging each change, and on the other half", total=None)

        def show(num_done: int, num_in_all: int) -> None:
            progress.update(task, completed=num_done, total=num_in_all)

        outcome = concluded(found, show)
    for table in (figures_table(outcome), *([gains_table(outcome)] if outcome.gains else [])):
        console.print(table)
    console.say(outcome.verdict)
    for path in write_outcome(outcome, tuning.start, options.out, command):
        console.say(f"Written: {path}", soft_wrap=True)


def _searched(
    recordings: Sequence[EvaluatedRecording], tuning: TuneOptions, console: Console
) -> Found:
    """Searches, and says on Ctrl-C how to go on."""
    from mnsf_ros.demo.console_progress import counting_progress
    from mnsf_ros.tuning.tune import search_settings

    so_far = "no trial is finished"
    try:
        with counting_progress(console) as progress:
            task = progress.add_task("trials", total=tuning.budget.num_trials)

            def show(num_done: int, lowest: float) -> None:
                nonlocal so_far
                so_far = f"{num_done} trials, lowest cost {lowest:.4f}"
                text = f"trials, lowest cost {lowest:.4f}"
                progress.update(task, completed=num_done, description=text)

            return search_settings(recordings, tuning, show)
    except KeyboardInterrupt:
        console.say(
            f"{so_far}; repeat the command with --resume to go on from {tuning.out}",
            soft_wrap=True,
        )
        raise
