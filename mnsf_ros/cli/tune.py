# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf tune`: settings of the method online fitted to recordings."""

import argparse
import shlex
import sys
from pathlib import Path

from mnsf_ros.cli.arguments import RESUME, Arguments, chosen
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.cli.evaluate import status_of
from mnsf_ros.errors import SettingsError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.presets import preset
from mnsf_ros.settings import parse_assignments
from mnsf_ros.tuning.options import TuneOptions

_EPILOG = """\
Settings are chosen on the first half of each recording and judged on the second, on
the first --max-examples of each half.

Goals:
  epe          three-way end point error; needs true flow
  consistency  without labels: points must land on a surface 0.3 s later

Files in DIR: tuned.yaml (a ROS parameter file with what changes), trials.log (all
trials, for --resume).

Exit status: 0: done; 5: a recording is damaged, its readable part was used.
"""


def add_tune(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.existing("bags BAG", "recordings", nargs="+")
    arguments.value("--out DIR", "folder for results", Path, default=Path("tuned"))
    arguments.flag("--resume", RESUME)
    arguments.assignments("set a parameter, which is then not tuned; may be repeated")
    arguments.declared(TuneOptions)
    # Of each half of a recording; they stay in memory.
    arguments.declared(EvaluationOptions, "max_examples", "seed", max_examples=40)
    arguments.points()
    return _EPILOG


def run_tune(options: argparse.Namespace) -> int:
    """Tunes with a bar; on Ctrl-C names the way to continue. Returns the exit status."""
    from mnsf_ros.tuning.tune import check_optuna, tune

    check_optuna()
    start = preset("online").changed(parse_assignments(options.assignments))
    if start.method.name != "online":
        raise SettingsError(f"method.name: got {start.method.name!r}; only online can be tuned")
    console, tuning = Console(), chosen(options, TuneOptions)
    evaluation = chosen(options, EvaluationOptions, settings=start)
    recordings = chosen_recordings(options.bags, options.points)
    try:
        with counting_progress(console) as progress:
            task = progress.add_task("trials", total=tuning.trials)

            def show(text: str, num_done: int, num_in_all: int) -> None:
                progress.update(task, description=text, completed=num_done, total=num_in_all)

            outcome = tune(recordings, evaluation, tuning, options.out, show, resume=options.resume)
    except KeyboardInterrupt:
        console.say(f"{options.out}: {RESUME}")
        raise
    for line in outcome.lines:
        console.say(line)
    if path := outcome.write_parameters(options.out, shlex.join(["mnsf", *sys.argv[1:]])):
        console.say(f"Written: {path}")
    return status_of(recordings)
