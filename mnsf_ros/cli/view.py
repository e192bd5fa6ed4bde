# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf view`: coloured motion in a browser, of a recording or of the running node."""

from __future__ import annotations

import argparse
import logging
import time
from importlib.resources import files
from pathlib import Path
from typing import TYPE_CHECKING

from mnsf_ros.cli.arguments import Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.cli.recordings import rate
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import PRESET_NAMES, preset

if TYPE_CHECKING:
    from mnsf_ros.view.view_server import Addresses

_LAYOUT = "foxglove_layout.json"


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    arguments = add_subcommand(
        subparsers,
        "view",
        "show flow live in a browser, or write an animation",
        _run,
        description="Shows the flow of a recording, without ROS, or that of the running node. "
        "Foxglove and\nLichtblick connect to it.",
    )
    arguments.value(
        "bag", "recording; without it, the topics of the node are shown", Path, nargs="?"
    )
    arguments.points()
    arguments.value("--preset", "settings of the method", default="online", choices=PRESET_NAMES)
    arguments.value("--rate", "playback speed, 1 as recorded", rate, 1.0)
    arguments.flag("--loop", "start again at the end of the recording")
    arguments.value("--node", "full name of the node", default="/scene_flow")
    arguments.value(
        "--host",
        "address to listen on; 0.0.0.0 lets other computers connect, without a password",
        default="127.0.0.1",
    )
    arguments.value("--port", "port to listen on", default=8765)
    arguments.value("--animation FILE", "write a WebP of the recording instead", Path)


def _run(options: argparse.Namespace) -> None:
    logging.basicConfig(format="%(message)s")
    console = Console(stderr=True)
    if options.bag is None:
        if options.animation is not None:
            raise SettingsError("--animation: needs a recording, mnsf view BAG --animation FILE")
        _show_node(options, console)
    elif options.animation is not None:
        if options.animation.suffix.lower() != ".webp":
            raise SettingsError(
                f"--animation: got {options.animation}, expected the name of a .webp file"
            )
        _animate(options, console)
    else:
        _show_recording(options, console)


def _show_recording(options: argparse.Namespace, console: Console) -> None:
    from mnsf_ros.recording.bag_reader import open_recording
    from mnsf_ros.recording.bag_topics import used_topics
    from mnsf_ros.view.estimated_sweeps import estimated_sweeps
    from mnsf_ros.view.recording_view import RecordingView
    from mnsf_ros.view.view_server import ViewServer

    settings = preset(options.preset)
    with open_recording(options.bag, console.warn) as reader:
        topic = used_topics(options.bag, reader.topics, options.points).points
        server = ViewServer()
        view = RecordingView(server)
        with (
            server.listening(options.host, options.port) as addresses,
            console.status("") as status,
        ):
            _say_where(console, addresses)

            def show(number: int) -> None:
                status.update(f"{number} sweeps of {topic}; Ctrl-C ends")

            while True:
                sweeps = estimated_sweeps(reader, topic, settings)
                view.play(sweeps, options.rate, time.sleep, show)
                if not options.loop:
                    break


def _animate(options: argparse.Namespace, console: Console) -> None:
    from mnsf_ros.recording.bag_reader import open_recording
    from mnsf_ros.recording.bag_topics import used_topics
    from mnsf_ros.view.animation import save_animation
    from mnsf_ros.view.estimated_sweeps import estimated_sweeps

    with open_recording(options.bag, console.warn) as reader, console.status("estimating"):
        topic = used_topics(options.bag, reader.topics, options.points).points
        sweeps = estimated_sweeps(reader, topic, preset(options.preset))
        number = save_animation(sweeps, options.animation)
    console.say(f"animation {options.animation} ({number} pictures)", soft_wrap=True)


def _show_node(options: argparse.Namespace, console: Console) -> None:
    from mnsf_ros.node.environment import prepare_environment, require_ros

    require_ros()
    prepare_environment()
    from mnsf_ros.node.raw_topics import RawTopics
    from mnsf_ros.view.node_view import NodeView
    from mnsf_ros.view.view_server import ViewServer

    server = ViewServer()
    with RawTopics("mnsf_view") as ros:
        view = NodeView(server, ros, options.node)
        with (
            server.listening(options.host, options.port) as addresses,
            console.status("") as status,
        ):
            _say_where(console, addresses)
            for number in view.run():
                found = "found" if ros.num_publishers(f"{options.node}/flow") else "not found yet"
                status.update(
                    f"{options.node} is {found}; {number} topics are looked at; Ctrl-C ends"
                )


def _say_where(console: Console, addresses: Addresses) -> None:
    layout = files("mnsf_ros.view").joinpath(_LAYOUT)
    url, page = addresses
    console.say(f"serving   {url}", soft_wrap=True)
    console.say(f"browser   {page} (or connect Lichtblick to {url})", soft_wrap=True)
    console.say(f"layout    {layout} (import it there)", soft_wrap=True)
