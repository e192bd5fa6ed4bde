# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf convert`: a sequence of a public data set as a recording with truth."""

from __future__ import annotations

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import FORCE, Subparsers, add_subcommand
from mnsf_ros.cli.console import Console
from mnsf_ros.datasets.formats import FORMATS, TruthSettings, open_source


def add_to(subparsers: Subparsers) -> None:
    """Adds the subcommand."""
    formats = "\n".join(f"  {name:14} {one.source}" for name, one in FORMATS.items())
    arguments = add_subcommand(
        subparsers,
        "convert",
        "write a sequence of a public data set as a recording with its true flow",
        _run,
        epilog=f"formats and their sources:\n{formats}\n\nDetails: docs/recordings.md",
    )
    arguments.value("format FORMAT", ", ".join(FORMATS), choices=FORMATS)
    source_text = "file or folder of the data set; see the list of formats below"
    arguments.value("source SOURCE", source_text, Path)
    arguments.value("out OUT", "folder to write, or a single file OUT.mcap", Path)
    arguments.flag("--force", FORCE)
    arguments.flag("--compress", "compress the recording (zstd)")
    arguments.value("--sequence NAME", "scene (nuscenes) or segment (waymo), if several")
    arguments.value("--labels DIR", "scene flow labels of the log (argoverse2)", Path)
    arguments.value("--first N", "first sweep, counted from 0", default=0)
    arguments.value("--count N", "number of sweeps (default: all)", int)
    margin_m = TruthSettings.box_margin_m
    arguments.value(
        "--box-margin M", "enlarge boxes by M metres in each dimension", default=margin_m
    )
    arguments.flag("--unlabelled-static", "treat unlabelled points as static instead of as unknown")


def _run(options: argparse.Namespace) -> None:
    from mnsf_ros.datasets.recording_writer import write_recording
    from mnsf_ros.demo.console_progress import counting_progress
    from mnsf_ros.recording.new_folder import check_target

    check_target(options.out, overwrite=options.force)
    settings = TruthSettings(options.box_margin, options.unlabelled_static)
    source = open_source(
        options.format, options.source, sequence=options.sequence, labels=options.labels
    ).part(options.first, options.count)
    console = Console()
    with counting_progress(console) as progress:
        task = progress.add_task(f"converting {options.source.name}", total=source.num_sweeps)
        summary = write_recording(
            source,
            options.out,
            settings,
            lambda done: progress.update(task, completed=done),
            overwrite=options.force,
            compress=options.compress,
        )
    lines = [f"{summary.num_sweeps} sweeps in {options.out}", str(summary)]
    for line in (*lines, *(f"warning: {text}" for text in summary.warnings())):
        console.say(line, soft_wrap=True)
