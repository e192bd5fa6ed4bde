"""`mnsf simulate`: a recording of a simulated street, with its true flow."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from mnsf_ros.simulation.settings import BEAM_CHOICES, SimulationSettings

_DEFAULTS = SimulationSettings()


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser(
        "simulate", help="write a recording of a simulated street with its true flow"
    )
    parser.add_argument("out", type=Path, help="folder to write (rosbag2, mcap)")
    parser.add_argument("--force", action="store_true", help="overwrite an existing recording")
    for name, kind, unit, text in (
        ("seed", int, "N", "chooses street, traffic and noise"),
        ("duration_s", float, "S", "duration in seconds"),
        ("rate_hz", float, "HZ", "sweeps per second"),
        ("num_beams", int, "N", f"lasers: {', '.join(map(str, BEAM_CHOICES))}"),
        ("num_columns", int, "N", "azimuth steps of a sweep"),
        ("range_noise_m", float, "M", "standard deviation of the range"),
        ("dropout", float, "SHARE", "share of returns that are dropped"),
        ("ego_speed_m_s", float, "M/S", "speed of the vehicle with the lidar"),
        ("max_range_m", float, "M", "maximum range of the lidar"),
    ):
        default = getattr(_DEFAULTS, name)
        parser.add_argument(
            f"--{name.replace('_', '-')}",
            type=kind,
            default=default,
            metavar=unit,
            help=f"{text} (default {default})",
        )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.demo.console_progress import simulate_with_progress

    values = {name: getattr(options, name) for name in SimulationSettings.__dataclass_fields__}
    settings = SimulationSettings(**values)
    simulate_with_progress(settings, options.out, Console(), overwrite=options.force)
