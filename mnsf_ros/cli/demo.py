"""`mnsf demo`: a recording through the live node, with tables and a picture at the end."""

from __future__ import annotations

import argparse
from pathlib import Path

from rich.console import Console

from mnsf_ros.node.main import require_ros
from mnsf_ros.presets import PRESET_NAMES, preset


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser(
        "demo", help="replay a recording to the live node and show the flow"
    )
    parser.add_argument("--bag", type=Path, help="recording; without it, a street is simulated")
    parser.add_argument(
        "--topic", help="its PointCloud2 topic; needed only if the recording has several"
    )
    parser.add_argument(
        "--preset",
        choices=PRESET_NAMES,
        default="online",
        help="settings of the node (default: online)",
    )
    parser.add_argument(
        "--duration", type=float, default=6.0, metavar="S", help="length of the simulated recording"
    )
    parser.add_argument("--seed", type=int, default=0, help="seed of the simulated recording")
    parser.add_argument(
        "--out", type=Path, default=Path("demo"), metavar="DIR", help="folder for all that is made"
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    require_ros()
    from mnsf_ros.demo.demo_run import run_demo
    from mnsf_ros.simulation.settings import SimulationSettings

    street = SimulationSettings(seed=options.seed, duration_s=options.duration)
    run_demo(options.bag or street, options.topic, preset(options.preset), options.out, Console())
