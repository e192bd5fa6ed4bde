# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf simulate`: a recording of a simulated street, with its true flow."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import FORCE, Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.simulation.settings import SimulationSettings, simulation_settings

# Of values without a unit in their name.
_METAVARS = {int: "N", float: "SHARE", str: "NAME"}


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    summary = "write a recording of a simulated street with its true flow"
    arguments = add_subcommand(subparsers, "simulate", summary, _run)
    arguments.value("out", "folder to write, or a file that ends in .mcap", Path)
    arguments.flag("--force", FORCE)
    for setting in simulation_settings():
        metavar = setting.unit.upper() or _METAVARS[setting.kind]
        name = f"--{setting.name.replace('_', '-')} {metavar}"
        arguments.value(name, setting.text, default=setting.default)


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.demo.console_progress import simulate_with_progress

    settings = SimulationSettings(
        **{setting.name: getattr(options, setting.name) for setting in simulation_settings()}
    )
    console = Console()
    simulate_with_progress(settings, options.out, console, overwrite=options.force)
    console.say(
        f"{options.out}: {settings.num_sweeps} sweeps of the scenario {settings.scenario} with "
        f"true flow, seed {settings.seed}",
        soft_wrap=True,
    )
