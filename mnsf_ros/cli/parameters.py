# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf parameters`: all settings with their values, as YAML or as a table."""

import argparse

from mnsf_ros.cli.arguments import Arguments
from mnsf_ros.presets import PRESET_NAMES, preset
from mnsf_ros.settings_documents import settings_markdown, settings_yaml

_MEANINGS = {
    "online": "The default: ego motion plus one rigid motion per object.",
    "mnsf": "The paper's networks live: warm-started, fitted where something may move.",
    "paper": "MNSF as published, every estimate from scratch: slow, for comparison.",
    "authors": "MNSF as in its authors' released code, where that differs from the paper.",
}
TITLES = {
    name: f"{text} Written by `mnsf parameters --preset {name}`."
    for name, text in _MEANINGS.items()
}


def add_parameters(arguments: Arguments) -> None:
    """Declares the arguments."""
    arguments.preset("settings to print", "online")
    arguments.value(
        "--format",
        "yaml: a ROS parameter file; markdown: the table of docs/parameters.md, all presets",
        default="yaml",
        choices=("yaml", "markdown"),
    )


def run_parameters(options: argparse.Namespace) -> None:
    """Prints the settings."""
    if options.format == "yaml":
        text = settings_yaml(preset(options.preset), TITLES[options.preset])
    else:
        text = settings_markdown({name: preset(name) for name in PRESET_NAMES})
    print(text, end="")
