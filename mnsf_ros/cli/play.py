"""`mnsf play`: publishes a recording."""

from __future__ import annotations

import argparse
import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from mnsf_ros.cli.arguments import Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.node.environment import prepare_environment, require_ros
from mnsf_ros.recording.bag_reader import BagReader

_SLOWEST: Final = 0.01
_FASTEST: Final = 100.0


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(subparsers, "play", "publish the messages of a recording", _run)
    arguments.value("bag", "recording, of ROS 1 or ROS 2", Path)
    arguments.value("--topics TOPIC", "only these topics", nargs="+")
    arguments.value("--rate", "speed over that of the recording", rate, 1.0)
    arguments.flag("--loop", "start again at the end")
    arguments.flag("--clock", "publish the time of the recording on /clock, for use_sim_time")


def _run(options: argparse.Namespace) -> None:
    require_ros()
    prepare_environment()
    from mnsf_ros.demo.console_progress import counting_progress
    from mnsf_ros.demo.play import PlayOptions, play

    console = Console(stderr=True)
    how = PlayOptions(options.topics or (), options.rate, options.loop, options.clock)
    with BagReader(options.bag) as reader, counting_progress(console) as progress:
        chosen = options.topics or reader.topics
        total = sum(reader.topics[topic].count for topic in chosen if topic in reader.topics)
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        task = progress.add_task(
            f"playing on ROS domain {domain}", total=None if options.loop else total
        )
        play(reader, how, lambda number: progress.update(task, completed=number), console.warn)


def rate(text: str) -> float:
    """Returns how fast to play.

    Raises:
        ArgumentTypeError: The text is no number, or one out of range.
    """
    with suppress(ValueError):
        if _SLOWEST <= float(text) <= _FASTEST:
            return float(text)
    raise argparse.ArgumentTypeError(f"got {text!r}, expected {_SLOWEST:g} to {_FASTEST:g}")
