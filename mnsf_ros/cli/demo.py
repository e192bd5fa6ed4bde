# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf demo`: a recording through the live node, with tables and a picture at the end."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.node.environment import require_ros
from mnsf_ros.presets import PRESET_NAMES, preset


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    summary = "replay a recording to the live node and show the flow"
    arguments = add_subcommand(subparsers, "demo", summary, _run)
    arguments.value("--bag", "recording; without it, a street is simulated", Path)
    arguments.points()
    arguments.value("--preset", "settings of the node", default="online", choices=PRESET_NAMES)
    arguments.value("--duration S", "length of the simulated recording", default=6.0)
    arguments.value("--seed", "seed of the simulated recording", default=0)
    arguments.value("--out DIR", "folder for all that is made", default=Path("demo"))


def _run(options: argparse.Namespace) -> None:
    require_ros()
    from mnsf_ros.demo.demo_run import run_demo
    from mnsf_ros.simulation.settings import SimulationSettings

    street = SimulationSettings(seed=options.seed, duration_s=options.duration)
    run_demo(options.bag or street, options.points, preset(options.preset), options.out, Console())
