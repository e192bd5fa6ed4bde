# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf view`: coloured motion in a browser, of a recording or of the running node."""

import argparse
from contextlib import suppress
from typing import Any, Final

from mnsf_ros.cli.arguments import Arguments, number_within, ros_name
from mnsf_ros.cli.console import Console
from mnsf_ros.cli.recordings import RATE
from mnsf_ros.errors import SettingsError
from mnsf_ros.presets import preset
from mnsf_ros.recording.bag_reader import open_recording
from mnsf_ros.recording.bag_topics import used_topics

# Options that only one of them has, and their defaults.
_OF_RECORDING: Final[dict[str, Any]] = {"points": None, "preset": "online", "rate": 1.0}
_OF_NODE: Final[dict[str, Any]] = {"node": "/scene_flow", "flow": None}


def add_view(arguments: Arguments) -> None:
    """Declares the arguments."""
    arguments.existing("bag", "recording; without it, the running node is shown", nargs="?")
    arguments.points()
    arguments.preset("settings for a recording", _OF_RECORDING["preset"])
    arguments.value("--rate", "playback speed, 1 as recorded", RATE, _OF_RECORDING["rate"])
    arguments.value("--node", "full name of the node", ros_name, _OF_NODE["node"])
    arguments.value("--flow TOPIC", "its flow, if that has another name than ~/flow", ros_name)
    arguments.value(
        "--host",
        "address to listen on; on 0.0.0.0 other computers connect, with a token",
        default="127.0.0.1",
    )
    arguments.value(
        "--port", "port to listen on, 0 for any", number_within(0, 65535, int), default=8766
    )


def run_view(options: argparse.Namespace) -> None:
    """Shows a recording or the node until Ctrl-C."""
    console = Console(stderr=True)
    is_node = options.bag is None
    for name, default in (_OF_RECORDING if is_node else _OF_NODE).items():
        if getattr(options, name) != default:
            shown, other = ("the node", "recordings") if is_node else (options.bag, "the node")
            raise SettingsError(f"--{name} is for {other}, but {shown} is shown; leave it out")
    (_show_node if options.bag is None else _show_recording)(options, console)


def _show_recording(options: argparse.Namespace, console: Console) -> None:
    from mnsf_ros.view.page_server import PageServer
    from mnsf_ros.view.recording_view import RecordingView

    with open_recording(options.bag, console.warn) as reader:
        topics = used_topics(options.bag, reader.topics, options.points)
        server = PageServer()
        view = RecordingView(server, reader, topics, preset(options.preset), options.rate)
        # Ctrl-C is how it ends, also for ros2 launch.
        with server.listening(options.host, options.port) as address, suppress(KeyboardInterrupt):
            _say_where(console, address)
            view.run()


def _show_node(options: argparse.Namespace, console: Console) -> None:
    from mnsf_ros.node.environment import prepare_environment

    prepare_environment()
    from mnsf_ros.view.node_view import NodeView
    from mnsf_ros.view.page_server import PageServer

    server = PageServer()
    with (
        NodeView(server, options.node, options.flow) as view,
        server.listening(options.host, options.port) as address,
        suppress(KeyboardInterrupt),
    ):
        _say_where(console, address)
        view.run()


def _say_where(console: Console, address: str) -> None:
    console.say(f"open {address} in a browser; Ctrl-C ends")
