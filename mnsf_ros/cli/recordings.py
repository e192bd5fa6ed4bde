# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf simulate`, `convert` and `play`: recordings that are made, or published."""

import argparse
import os
from contextlib import suppress
from pathlib import Path
from typing import Final

from mnsf_ros.cli.arguments import FORCE, Arguments, chosen, number_within
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.cli.evaluate import EXIT_INCOMPLETE
from mnsf_ros.datasets.formats import FORMATS, TruthSettings
from mnsf_ros.node.environment import prepare_environment
from mnsf_ros.recording.bag_files import check_target
from mnsf_ros.recording.bag_reader import open_recording
from mnsf_ros.recording.bag_topics import known_topic
from mnsf_ros.simulation.settings import SimulationSettings

# Speed of playing relative to the recording.
RATE: Final = number_within(0.01, 100.0)


def add_simulate(arguments: Arguments) -> None:
    """Declares the arguments of `mnsf simulate`."""
    arguments.value("out", "folder to write, or a file that ends in .mcap", Path)
    arguments.flag("--force", FORCE)
    arguments.flag("--nav2", "also write /tf, /odom, and the exact tracks on /truth/objects")
    arguments.declared(SimulationSettings)


def run_simulate(options: argparse.Namespace) -> None:
    """Writes a simulated street."""
    settings, console = chosen(options, SimulationSettings), Console()
    check_target(options.out, overwrite=options.force)
    from mnsf_ros.simulation.recording import write_recording

    with counting_progress(console) as progress:
        task = progress.add_task(f"simulating the scenario {settings.scenario}", total=None)

        def show(num_done: int, num_sweeps: int) -> None:
            progress.update(task, completed=num_done, total=num_sweeps)

        simulator = write_recording(
            settings, options.out, show, overwrite=options.force, nav2=options.nav2
        )
    console.say(simulator.scene.text)
    number = simulator.num_sweeps
    console.say(
        f"{options.out}: {number} sweep{'s'[: number != 1]} of the scenario {settings.scenario} "
        f"with true flow, seed {settings.seed}"
    )


def add_convert(arguments: Arguments) -> str:
    """Declares the arguments of `mnsf convert`."""
    arguments.value("format FORMAT", ", ".join(FORMATS), choices=FORMATS)
    source_text = "file or folder of the data set; see the list of formats below"
    arguments.existing("source SOURCE", source_text)
    arguments.value("out OUT", "folder to write, or a single file OUT.mcap", Path)
    arguments.flag("--force", FORCE)
    arguments.value("--sequence NAME", "scene (nuscenes) or segment (waymo), if several")
    arguments.value("--first N", "first sweep, counted from 0", default=0)
    arguments.value("--count N", "number of sweeps (default: all)", int)
    arguments.value(
        "--box-margin M",
        "enlarge boxes by M metres in each dimension",
        number_within(0, 10),
        TruthSettings.box_margin_m,
    )
    arguments.flag("--unlabelled-static", "treat unlabelled points as static instead of as unknown")
    arguments.flag(
        "--official-labels", "points belong to boxes as in the official labels of Argoverse 2"
    )
    formats = "\n".join(f"  {name:14} {one.source}" for name, one in FORMATS.items())
    return f"formats and their sources:\n{formats}\n\nDetails: docs/recordings.md"


def run_convert(options: argparse.Namespace) -> None:
    """Writes a sequence of a data set."""
    check_target(options.out, overwrite=options.force)
    from mnsf_ros.datasets.conversion import open_source, write_recording

    settings = TruthSettings(options.box_margin, options.unlabelled_static, options.official_labels)
    source = open_source(options.format, options.source, options.sequence)
    source = source.part(options.first, options.count)
    console = Console()
    with counting_progress(console) as progress:
        task = progress.add_task(f"converting {options.source.name}", total=source.num_sweeps)
        summary = write_recording(
            source,
            options.out,
            settings,
            lambda done: progress.update(task, completed=done),
            overwrite=options.force,
        )
    number = summary.num_sweeps
    console.say(f"{number} sweep{'s'[: number != 1]} in {options.out}")
    console.say(str(summary))
    for warning in filter(None, (source.note, summary.warning)):
        console.say(f"warning: {warning}")


def add_play(arguments: Arguments) -> None:
    """Declares the arguments of `mnsf play`."""
    arguments.existing("bag", "recording, of ROS 1 or ROS 2")
    arguments.value("--topics TOPIC,...", "only these topics")
    arguments.value("--rate", "playback speed, 1 as recorded", RATE, 1.0)
    arguments.flag("--loop", "start again at the end")
    arguments.flag("--clock", "publish the time of the recording on /clock, for use_sim_time")
    arguments.flag("--wait", "start when somebody listens to a cloud of the recording")


def run_play(options: argparse.Namespace) -> int:
    """Publishes a recording; returns the exit status."""
    prepare_environment()
    from mnsf_ros.node.play import play

    console = Console(stderr=True)
    topics = tuple(map(str.strip, options.topics.split(","))) if options.topics is not None else ()
    with open_recording(options.bag, console.warn) as reader:
        for topic in topics:
            known_topic(reader.path, reader.topics, topic)
        total = sum(reader.topics[topic].count for topic in topics or reader.topics)
        text = f"playing {options.bag} on ROS domain {os.environ.get('ROS_DOMAIN_ID', '0')}"
        bar = counting_progress(console)
        if options.loop:  # A bar would never end.
            console.say(f"{text}, again and again")
            bar.disable = True
        # Ctrl-C is no failure, also for ros2 launch.
        with suppress(KeyboardInterrupt), bar as progress:
            task = progress.add_task(text, total=total)
            play(
                reader,
                lambda number: progress.update(task, completed=number),
                console.warn,
                topics=topics,
                rate=options.rate,
                loop=options.loop,
                clock=options.clock,
                wait=options.wait,
            )
        return EXIT_INCOMPLETE if reader.damages else 0
