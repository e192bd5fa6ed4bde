"""`mnsf parameters`: all settings with their values, as YAML or as a table."""

from __future__ import annotations

import argparse

from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings_documents import settings_markdown, settings_yaml

TITLES = {
    "online": (
        "The default: ego motion plus one rigid motion per object. Written by "
        "`mnsf parameters --preset online`."
    ),
    "paper": (
        "MNSF as published, every estimate from scratch: slow, for comparison. Written by "
        "`mnsf parameters --preset paper`."
    ),
    "authors": (
        "MNSF as in its authors' released code, where that differs from the paper. Written by "
        "`mnsf parameters --preset authors`."
    ),
}


def add_to(subparsers: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Adds the subcommand."""
    parser = subparsers.add_parser("parameters", help="print all settings of a preset")
    parser.add_argument("--preset", choices=PRESET_NAMES, default="online")
    parser.add_argument(
        "--format",
        choices=("yaml", "markdown"),
        default="yaml",
        help="yaml: a ROS parameter file; markdown: the table of docs/parameters.md, all presets",
    )
    parser.set_defaults(run=_run)


def _run(options: argparse.Namespace) -> None:
    if options.format == "yaml":
        text = settings_yaml(preset(options.preset), TITLES[options.preset])
    else:
        text = settings_markdown({name: preset(name) for name in PRESET_NAMES})
    print(text, end="")
