# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf export`: estimates of recordings as files of other projects."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import Final

from mnsf_ros.cli.arguments import Arguments, chosen_settings
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.datasets.argoverse2_submission import submission
from mnsf_ros.datasets.exported_sweep import ExportedSweep
from mnsf_ros.datasets.write_open_scene_flow import open_scene_flow_writer
from mnsf_ros.errors import DatasetError
from mnsf_ros.evaluation.exported_sweeps import exported_sweeps
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording, choose_topics, named_recordings

_EPILOG: Final = """\
formats:
  opensceneflow  OUT is a folder. Estimates are added to OUT/NAME.h5, the file of the
                 recording NAME; without one it is made, with sweeps, poses and truth.
  argoverse2     OUT is the .zip of a submission: the sweeps and points of --mask, for
                 recordings named by their logs, as mnsf convert argoverse2 makes them.

Points without an estimate have the flow of static points.

Examples:
  mnsf export opensceneflow street --out flows
  mnsf export argoverse2 LOG... --out online.zip --mask test-masks.zip
"""


def add_export(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.value("format FORMAT", ", ".join(_FORMATS), choices=_FORMATS)
    arguments.recordings("bags BAG", "recordings", nargs="+")
    arguments.value("--out OUT", "folder or file to write, see below", Path, required=True)
    arguments.value("--method NAME", "see docs/evaluation.md", default="online")
    arguments.settings(default="online")
    arguments.points()
    arguments.value("--odometry TOPIC", "sensor poses (default: /truth/odometry if present)")
    arguments.value("--key NAME", "name of the estimates in .h5 files (default: the method)")
    arguments.flag("--labels", "also write the estimates as labels to train on (.h5)")
    arguments.value("--mask ZIP", "archive of the masks of the challenge (argoverse2)", Path)
    arguments.flag("--force", "replace estimates that are there already")
    return _EPILOG


def run_export(options: argparse.Namespace) -> None:
    """Writes the estimates."""
    named = named_recordings(options.bags)
    for name, path in named:
        if "/" in name:
            raise DatasetError(f"{path}: has the name of another recording; export them apart")
    recordings = [
        choose_topics(path, name, options.points, odometry=options.odometry) for name, path in named
    ]
    _FORMATS[options.format](options, recordings, EvaluationOptions(chosen_settings(options)))


def _export_open_scene_flow(
    options: argparse.Namespace, recordings: list[EvaluatedRecording], settings: EvaluationOptions
) -> None:
    if options.mask is not None:
        raise DatasetError("--mask: is for the format argoverse2")
    options.out.mkdir(parents=True, exist_ok=True)
    for recording in recordings:
        path = options.out / f"{recording.name}.h5"
        key = options.key or options.method
        with open_scene_flow_writer(
            path, key, labels=options.labels, overwrite=options.force
        ) as writer:
            _export(recording, options.method, settings, writer.write, f"{path}, {key!r}")


def _export_argoverse2(
    options: argparse.Namespace, recordings: list[EvaluatedRecording], settings: EvaluationOptions
) -> None:
    if options.mask is None or options.labels or options.key:
        raise DatasetError("argoverse2: expected --mask ZIP, and neither --key nor --labels")
    with submission(options.out, options.mask, overwrite=options.force) as archive:
        for recording in recordings:

            def write(sweep: ExportedSweep, log: str = recording.name) -> None:
                archive.write(log, sweep)

            _export(recording, options.method, settings, write, str(options.out))
        missing = archive.num_missing()
    if missing:
        number = sum(missing.values())
        Console(stderr=True).warn(
            f"{options.out}: lacks {number} sweeps of {len(missing)} logs of the challenge, for "
            f"example of {min(missing)}"
        )


_FORMATS: Final = {"opensceneflow": _export_open_scene_flow, "argoverse2": _export_argoverse2}


def _export(
    recording: EvaluatedRecording,
    method: str,
    settings: EvaluationOptions,
    write: Callable[[ExportedSweep], None],
    target: str,
) -> None:
    console = Console()
    num_sweeps = num_estimated = 0
    with counting_progress(console) as progress:
        task = progress.add_task(f"estimating {recording.name}", total=recording.num_sweeps)
        for sweep in exported_sweeps(recording, method, settings, console.warn):
            write(sweep)
            num_sweeps += 1
            num_estimated += sweep.estimate is not None
            progress.update(task, completed=num_sweeps)
    console.say(
        f"{target}: {num_sweeps} sweeps of {recording.name}, {num_estimated} with an estimate of "
        f"{method}",
        soft_wrap=True,
    )
