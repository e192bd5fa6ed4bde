# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
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

_SLOWEST: Final = 0.01
_FASTEST: Final = 100.0


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(subparsers, "play", "publish the messages of a recording", _run)
    arguments.value("bag", "recording, of ROS 1 or ROS 2", Path)
    arguments.value("--topics TOPIC,...", "only these topics")
    arguments.value("--rate", "playback speed, 1 as recorded", rate, 1.0)
    arguments.flag("--loop", "start again at the end")
    arguments.flag("--clock", "publish the time of the recording on /clock, for use_sim_time")


def _run(options: argparse.Namespace) -> None:
    require_ros()
    prepare_environment()
    from mnsf_ros.demo.console_progress import counting_progress
    from mnsf_ros.demo.play import PlayOptions, play
    from mnsf_ros.recording.bag_topics import known_topic
    from mnsf_ros.recording.inspection import open_recording

    console = Console(stderr=True)
    topics = tuple(filter(None, map(str.strip, (options.topics or "").split(","))))
    how = PlayOptions(topics, options.rate, options.loop, options.clock)
    with open_recording(options.bag, console.warn) as reader:
        for topic in topics:
            known_topic(reader.path, reader.topics, topic)
        total = sum(reader.topics[topic].count for topic in topics or reader.topics)
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        with counting_progress(console) as progress:
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
