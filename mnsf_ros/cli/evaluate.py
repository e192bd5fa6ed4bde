# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf evaluate`: scores methods on recordings; `mnsf report`: the HTML report from its rows."""

import argparse
from collections.abc import Iterable
from pathlib import Path
from typing import Final

from mnsf_ros.cli.arguments import RESUME, Arguments, number_within
from mnsf_ros.cli.console import Console
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording

DEFAULT_METHODS: Final = ("online", "mnsf")
EXIT_INCOMPLETE: Final = 5

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
    arguments.existing("bags BAG", "recordings", nargs="+")
    topics = arguments.group("topics (the same for all recordings)")
    topics.points()
    topics.value(
        "--odometry TOPIC",
        "sensor poses (Odometry or /tf), for the method ego, and for other methods with "
        "--set ego_motion.source=odometry (default: /truth/odometry if present)",
    )
    what = arguments.group("methods and points")
    what.value(
        "--methods NAME,...",
        "methods to compare, see docs/evaluation.md; NAME+SETTING=VALUE is a variant of a method, "
        "PRESET/NAME has the settings of a preset (paper/mnsf,mnsf/mnsf), "
        "file:DIR scores flow from files, "
        "command:LINE runs another program (the rest of the text is its command line); may be "
        f"repeated (default: {','.join(DEFAULT_METHODS)}; without PyTorch {DEFAULT_METHODS[0]})",
        action="append",
    )
    what.settings()
    what.flag(
        "--pairs",
        "evaluate every two consecutive sweeps, also without a sweep before them; methods use two "
        "sweeps if they can, else report an error",
    )
    what.declared(EvaluationOptions, realtime=None, pictures=3)
    _add_run_arguments(arguments.group("run"))
    return _EPILOG


def _add_run_arguments(group: Arguments) -> None:
    group.value(
        "--out DIR", "folder for results (default: a new one named after recording and time)", Path
    )
    group.flag("--resume", RESUME)
    group.value("--workers N", "processes to use", number_within(1, 1024, int), 1)
    group.value("--ray ADDRESS", "run on a Ray cluster; local starts one here")
    group.value(
        "--num-gpus G",
        "GPU share of each --ray task (default: 1 with compute.device=cuda, else 0)",
        number_within(0, 1024),
    )


def run_evaluate(options: argparse.Namespace) -> int:
    """Evaluates, and returns the exit status."""
    from mnsf_ros.cli.evaluation import evaluate

    return evaluate(options)


def status_of(recordings: Iterable[EvaluatedRecording]) -> int:
    """Warns of the damage that was met in recordings; returns the exit status of a command."""
    damages = [damage for recording in recordings for damage in recording.damages]
    for damage in damages:
        Console(stderr=True).warn(damage)
    return EXIT_INCOMPLETE if damages else 0


def add_report(arguments: Arguments) -> None:
    """Declares the arguments of `mnsf report`."""
    arguments.existing("folder", "folder of `mnsf evaluate --out`")
    arguments.value(
        "--method NAME",
        "method whose worst sweeps are shown (default: the first that is no reference)",
    )


def run_report(options: argparse.Namespace) -> None:
    """Writes the report again."""
    from mnsf_ros.evaluation.run_folder import RunFolder
    from mnsf_ros.report.page import write_report
    from mnsf_ros.report.run_results import read_results

    folder = RunFolder(options.folder)
    results = read_results(folder, options.method)
    path = write_report(folder, results)
    console = Console()
    for note in results.notes:
        if note.is_incomplete:
            console.warn(note.text)
    console.say(f"Report: {path}")
