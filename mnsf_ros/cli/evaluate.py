# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf evaluate`: scores methods on recordings; `mnsf report`: the HTML report from its rows."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import ALL, RESUME, Arguments, number_or_all
from mnsf_ros.cli.console import Console, complain
from mnsf_ros.cli.evaluation import DEFAULT_METHODS, evaluate
from mnsf_ros.evaluation.run_folder import RunFolder, StoppedError
from mnsf_ros.report.page import write_report
from mnsf_ros.report.run_results import read_results

EXIT_STOPPED = 4
EXIT_INCOMPLETE = 5

_EPILOG = """\
Examples:
  mnsf simulate street
  mnsf evaluate street
  mnsf evaluate street --methods zero,online --preset online --realtime 1 --out results

Exit status:
  0    complete
  2    an argument, setting or recording cannot be used; nothing was run
  3    it takes more memory than --max-memory
  4    stopped: results cannot be written (disk full), or a worker was killed
  5    done, but incomplete: a recording is damaged (its readable part was
       evaluated) or has nothing to evaluate, a method cannot be made or failed
       on every example of a recording, or report.html could not be written
  130  interrupted

After 4 and 130, finished results are kept. To continue, repeat the command
with --out and --resume.
"""


def add_evaluate(arguments: Arguments) -> str:
    """Declares the arguments of `mnsf evaluate`."""
    arguments.recordings("bags BAG", "recordings", nargs="+")
    _add_topics(arguments.group("topics (the same for all recordings)"))
    _add_method_arguments(arguments.group("methods and points"))
    _add_run_arguments(arguments.group("run"))
    return _EPILOG


def _add_topics(group: Arguments) -> None:
    group.points()
    group.value("--truth TOPIC", "true flow (default: /truth/flow if present)")
    group.value(
        "--odometry TOPIC",
        "sensor poses, for the method ego, and for other methods with "
        "--set ego_motion.source=odometry (default: /truth/odometry if present)",
    )


def _add_method_arguments(group: Arguments) -> None:
    group.value(
        "--methods NAME,...",
        "methods to compare, see docs/evaluation.md; NAME+SETTING=VALUE is a variant of a method, "
        "file:DIR scores flow from files, "
        "command:LINE runs another program (the rest of the text is its command line); may be "
        f"repeated (default: {','.join(DEFAULT_METHODS)}; without PyTorch {DEFAULT_METHODS[0]})",
        action="append",
    )
    group.settings()
    group.value("--num-points N", "score N random points of each sweep", number_or_all, default=ALL)
    group.flag(
        "--pairs",
        "evaluate every two consecutive sweeps, also without a sweep before them; methods use two "
        "sweeps if they can, else report an error",
    )
    group.value(
        "--every N",
        "score every N-th example only, not with --realtime; methods that carry state still "
        "estimate those between",
        default=1,
    )
    group.value("--seed S", "seed of the random points and of the methods", default=0)
    group.value(
        "--ground",
        "find ground points by the flags in the truth, where there is truth, or by the ground "
        "settings, as the live node does",
        default="truth",
        choices=("truth", "settings"),
    )


def _add_run_arguments(group: Arguments) -> None:
    group.value(
        "--out DIR", "folder for results (default: a new one named after recording and time)", Path
    )
    group.flag("--resume", RESUME)
    group.value(
        "--realtime RATE",
        "replay in real time: triplets are dropped as in the live node; 1 is the speed of the "
        "recording, 2 twice as fast (default: no drops)",
        float,
    )
    group.value(
        "--pictures N",
        "draw the N worst sweeps of each method, and an animation, for report.html",
        default=3,
    )
    group.value("--workers N", "processes to use", default=1)
    group.value("--ray ADDRESS", "run on a Ray cluster; local starts one here")
    group.value(
        "--num-gpus G",
        "GPU share of each --ray task (default: 1 with compute.device=cuda, else 0)",
        float,
    )


def run_evaluate(options: argparse.Namespace) -> int:
    """Evaluates, and returns the exit status."""
    try:
        is_complete = evaluate(options, Console())
    except StoppedError as error:
        complain(
            f"{error}. Finished results are kept; to continue, repeat the command with "
            f"--out {options.out} --resume"
        )
        return EXIT_STOPPED
    return 0 if is_complete else EXIT_INCOMPLETE


def add_report(arguments: Arguments) -> None:
    """Declares the arguments of `mnsf report`."""
    arguments.value("folder", "folder of `mnsf evaluate --out`", Path)
    arguments.value("--pictures N", "number of worst sweeps shown in pictures", default=3)
    arguments.value("--method NAME", "method whose worst sweeps are shown (default: the first one)")


def run_report(options: argparse.Namespace) -> None:
    """Writes the report again."""
    folder = RunFolder(options.folder)
    results = read_results(folder, options.method)
    path = write_report(folder, results, max(0, options.pictures))
    console = Console()
    for note in results.notes:
        if note.is_incomplete:
            console.warn(note.text)
    console.say(f"Report: {path}")
