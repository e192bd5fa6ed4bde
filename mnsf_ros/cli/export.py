# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf export`: estimates of recordings as files of other projects."""

import argparse
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.cli.arguments import Arguments, chosen_settings
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.cli.evaluate import status_of
from mnsf_ros.errors import DatasetError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording, chosen_recordings

if TYPE_CHECKING:
    from mnsf_ros.datasets.exported_sweep import ExportedSweep

_EPILOG: Final = """\
formats:
  opensceneflow  OUT is a folder. Estimates are added to OUT/NAME.h5, the file of the
                 recording NAME; without one it is made, with sweeps, poses and truth.
  argoverse2-v3  OUT is the .zip of a submission to the leaderboard of 2026: residual flow
                 of all points in the sweeps of --index, for recordings named by their
                 scenes, as mnsf convert opensceneflow makes them.
  argoverse2-2023
                 OUT is the .zip of a submission to the challenge of 2023: the sweeps and
                 points of --mask, for recordings named by their logs, as mnsf convert
                 argoverse2 makes them.

Points without an estimate have the flow of static points.

Exit status: 0: complete; 5: a recording is damaged, its readable part was exported.

Examples:
  mnsf export opensceneflow street --out flows
  mnsf export argoverse2-v3 SCENE... --out online.zip --index index_eval.pkl
  mnsf export argoverse2-2023 LOG... --out online.zip --mask test-masks.zip
"""


def add_export(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.value("format FORMAT", ", ".join(_FORMATS), choices=_FORMATS)
    arguments.existing("bags BAG", "recordings", nargs="+")
    arguments.value("--out OUT", "folder or file to write, see below", Path, required=True)
    arguments.value("--method NAME", "see docs/evaluation.md", default="online")
    arguments.settings(default="online")
    arguments.points()
    arguments.value("--odometry TOPIC", "sensor poses (default: /truth/odometry if present)")
    arguments.value("--key NAME", "name of the estimates in .h5 files (default: the method)")
    arguments.flag("--labels", "also write the estimates as labels to train on (.h5)")
    arguments.existing("--mask ZIP", "masks of the challenge (argoverse2-2023)")
    arguments.existing("--index FILE", "index_eval.pkl of the leaderboard (argoverse2-v3)")
    arguments.flag("--force", "replace estimates that are there already")
    return _EPILOG


def run_export(options: argparse.Namespace) -> int:
    """Writes the estimates; returns the exit status."""
    recordings = chosen_recordings(options.bags, options.points, options.odometry)
    for recording in recordings:
        if "/" in recording.name:
            raise DatasetError(
                f"{recording.name}: has the name of another recording; export them apart"
            )
    _FORMATS[options.format](options, recordings, EvaluationOptions(chosen_settings(options)))
    return status_of(recordings)


def _export_open_scene_flow(
    options: argparse.Namespace, recordings: list[EvaluatedRecording], settings: EvaluationOptions
) -> None:
    if options.mask is not None or options.index is not None:
        raise DatasetError("--mask and --index: are for the formats argoverse2-…")
    from mnsf_ros.datasets.open_scene_flow import open_scene_flow_writer

    options.out.mkdir(parents=True, exist_ok=True)
    for recording in recordings:
        path = options.out / f"{recording.name}.h5"
        key = options.key or options.method.replace("/", "_")
        with open_scene_flow_writer(
            path, key, labels=options.labels, overwrite=options.force
        ) as writer:
            _export(recording, options.method, settings, writer.write, f"{path}, {key!r}")


def _export_argoverse2(
    options: argparse.Namespace, recordings: list[EvaluatedRecording], settings: EvaluationOptions
) -> None:
    name = _SUBMISSIONS[options.format]
    sweeps = getattr(options, name)
    if sweeps is None:
        raise DatasetError(f"{options.format}: --{name} is missing, the sweeps to write")
    if options.labels or options.key or (options.mask and options.index):
        raise DatasetError(f"{options.format}: takes --{name}, but no other option for files")
    from mnsf_ros.datasets.argoverse2_submission import submission_2023, submission_v3

    opened = submission_2023 if options.mask else submission_v3
    with opened(options.out, sweeps, overwrite=options.force) as archive:
        for recording in recordings:

            def write(sweep: "ExportedSweep", log: str = recording.name) -> None:
                archive.write(log, sweep)

            _export(recording, options.method, settings, write, str(options.out))
        missing = archive.num_missing()
    if missing:
        number = sum(missing.values())
        Console(stderr=True).warn(
            f"{options.out}: lacks {number} sweeps of {len(missing)} logs of the challenge, for "
            f"example of {min(missing)}"
        )


# The option that says which sweeps.
_SUBMISSIONS: Final = {
    "argoverse2-v3": "index",
    "argoverse2-2023": "mask",
}
_FORMATS: Final = {
    "opensceneflow": _export_open_scene_flow,
    **dict.fromkeys(_SUBMISSIONS, _export_argoverse2),
}


def _export(
    recording: EvaluatedRecording,
    method: str,
    options: EvaluationOptions,
    write: Callable[["ExportedSweep"], None],
    target: str,
) -> None:
    from mnsf_ros.evaluation.exported_sweeps import exported_sweeps

    console = Console()
    num_sweeps = num_estimated = 0
    with counting_progress(console) as progress:
        task = progress.add_task(f"estimating {recording.name}", total=recording.num_sweeps)
        for sweep in exported_sweeps(recording, method, options, console.warn):
            write(sweep)
            num_sweeps += 1
            num_estimated += sweep.estimate is not None
            progress.update(task, completed=num_sweeps)
    console.say(
        f"{target}: {num_sweeps} sweeps of {recording.name}, {num_estimated} with an estimate of "
        f"{method}"
    )
