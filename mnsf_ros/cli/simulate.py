"""`mnsf simulate`: a recording of a simulated street, with its true flow."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import FORCE, Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.simulation.settings import BEAM_CHOICES, SCENARIOS, SimulationSettings

_OPTIONS = {
    "seed": ("N", "chooses street, traffic and noise"),
    "duration_s": ("S", "duration in seconds"),
    "rate_hz": ("HZ", "sweeps per second"),
    "num_beams": ("N", f"lasers: {', '.join(map(str, BEAM_CHOICES))}"),
    "num_columns": ("N", "azimuth steps of a sweep"),
    "range_noise_m": ("M", "standard deviation of the range"),
    "dropout": ("SHARE", "share of returns that are dropped"),
    "ego_speed_m_s": ("M/S", "speed of the vehicle with the lidar"),
    "max_range_m": ("M", "maximum range of the lidar"),
    "scenario": ("NAME", f"street and traffic: {', '.join(SCENARIOS)}"),
}


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    summary = "write a recording of a simulated street with its true flow"
    arguments = add_subcommand(subparsers, "simulate", summary, _run)
    arguments.value("out", "folder to write, or a file that ends in .mcap", Path)
    arguments.flag("--force", FORCE)
    for name, (unit, text) in _OPTIONS.items():
        default = getattr(SimulationSettings, name)
        arguments.value(f"--{name.replace('_', '-')} {unit}", text, default=default)


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.demo.console_progress import simulate_with_progress

    settings = SimulationSettings(**{name: getattr(options, name) for name in _OPTIONS})
    console = Console()
    simulate_with_progress(settings, options.out, console, overwrite=options.force)
    console.say(
        f"{options.out}: {settings.num_sweeps} sweeps of the scenario {settings.scenario} with "
        f"true flow, seed {settings.seed}",
        soft_wrap=True,
    )
