# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf explain`: why one place of a sweep was called dynamic or not."""

import argparse
import math
from contextlib import suppress
from decimal import Decimal
from pathlib import Path

from mnsf_ros.cli.arguments import Arguments, chosen_settings
from mnsf_ros.cli.console import Console
from mnsf_ros.cli.evaluate import status_of
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import chosen_recordings

# Of a header with 32 bits of seconds.
_MAX_STAMP_S = 2**32
_EPILOG = """\
Example:
  mnsf explain street --stamp 1716451202.7 --at 10.7,29 --picture place.png

Exit status: 0: done; 5: the recording is damaged, its readable part was used.

The report of an evaluation lists the worst missed movers with stamp and place.
"""


def add_explain(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.existing("bag BAG", "recording")
    arguments.value("--stamp S", "header stamp of the sweep in seconds", _stamp_s, required=True)
    arguments.value("--at X,Y", "place in metres, sensor frame", _place, required=True)
    arguments.value(
        "--picture FILE", "write the object in the other sweeps as a PNG file", _new_file
    )
    arguments.points()
    arguments.value("--odometry TOPIC", "sensor poses, with --set ego_motion.source=odometry")
    arguments.method()
    arguments.settings(default="online")
    return _EPILOG


def _stamp_s(text: str) -> Decimal:
    # Not a float: it has too few digits for nanoseconds since 1970.
    with suppress(ArithmeticError):
        seconds = Decimal(text)
        if 0 <= seconds < _MAX_STAMP_S:
            return seconds
    raise argparse.ArgumentTypeError(f"got {text!r}, expected seconds since 1970")


def _place(text: str) -> tuple[float, float]:
    with suppress(ValueError):
        x, y = map(float, text.split(","))
        if math.isfinite(x) and math.isfinite(y):
            return x, y
    raise argparse.ArgumentTypeError(f"got {text!r}, expected X,Y in metres")


def _new_file(text: str) -> Path:
    path = Path(text)
    if path.is_dir() or not path.parent.is_dir():
        raise argparse.ArgumentTypeError(f"got {text!r}, expected a file in a folder that exists")
    return path


def run_explain(options: argparse.Namespace) -> int:
    """Prints the decision; returns the exit status."""
    from mnsf_ros.report.explanation import explain
    from mnsf_ros.sweeps.sweep import NANOSECONDS

    (recording,) = chosen_recordings([options.bag], options.points, options.odometry)
    evaluation = EvaluationOptions(chosen_settings(options))
    console = Console()
    place = round(options.stamp * NANOSECONDS), options.at
    lines, picture = explain(recording, evaluation, *place, options.method or "")
    for line in lines:
        console.say(line)
    if options.picture and not picture:
        console.warn(f"{options.picture}: not written, there is no object at this place")
    elif picture and options.picture:
        options.picture.write_bytes(picture)
    return status_of([recording])
