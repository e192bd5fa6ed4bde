# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf export`: estimates of recordings as files of other projects."""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.cli.arguments import Arguments, chosen_settings
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.datasets.argoverse2_submission import submission_2023, submission_v3
from mnsf_ros.datasets.exported_sweep import ExportedSweep
from mnsf_ros.datasets.open_scene_flow import open_scene_flow_writer
from mnsf_ros.errors import DatasetError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.outcomes import estimated
from mnsf_ros.evaluation.recordings import EvaluatedRecording, chosen_recordings
from mnsf_ros.evaluation.tracks import Findings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.ground_surface import ground_mask
from mnsf_ros.sweeps.sweep import Sweep

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

Examples:
  mnsf export opensceneflow street --out flows
  mnsf export argoverse2-v3 SCENE... --out online.zip --index index_eval.pkl
  mnsf export argoverse2-2023 LOG... --out online.zip --mask test-masks.zip
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
    arguments.value("--mask ZIP", "masks of the challenge (argoverse2-2023)", Path)
    arguments.value("--index FILE", "index_eval.pkl of the leaderboard (argoverse2-v3)", Path)
    arguments.flag("--force", "replace estimates that are there already")
    return _EPILOG


def run_export(options: argparse.Namespace) -> None:
    """Writes the estimates."""
    recordings = chosen_recordings(options.bags, options.points, options.odometry)
    for recording in recordings:
        if "/" in recording.name:
            raise DatasetError(
                f"{recording.name}: has the name of another recording; export them apart"
            )
    _FORMATS[options.format](options, recordings, EvaluationOptions(chosen_settings(options)))


def _export_open_scene_flow(
    options: argparse.Namespace, recordings: list[EvaluatedRecording], settings: EvaluationOptions
) -> None:
    if options.mask is not None or options.index is not None:
        raise DatasetError("--mask and --index: are for the formats argoverse2-…")
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
    opened, name = _SUBMISSIONS[options.format]
    sweeps = getattr(options, name)
    if sweeps is None or options.labels or options.key or (options.mask and options.index):
        raise DatasetError(f"{options.format}: expected --{name}, not --key, --labels and others")
    with opened(options.out, sweeps, overwrite=options.force) as archive:
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


# The option that says which sweeps.
_SUBMISSIONS: Final = {
    "argoverse2-v3": (submission_v3, "index"),
    "argoverse2-2023": (submission_2023, "mask"),
}
_FORMATS: Final = {
    "opensceneflow": _export_open_scene_flow,
    **dict.fromkeys(_SUBMISSIONS, _export_argoverse2),
}


def _export(
    recording: EvaluatedRecording,
    method: str,
    options: EvaluationOptions,
    write: Callable[[ExportedSweep], None],
    target: str,
) -> None:
    console = Console()
    num_sweeps = num_estimated = 0
    with counting_progress(console) as progress:
        task = progress.add_task(f"estimating {recording.name}", total=recording.num_sweeps)
        for sweep in _exported_sweeps(recording, method, options, console):
            write(sweep)
            num_sweeps += 1
            num_estimated += sweep.estimate is not None
            progress.update(task, completed=num_sweeps)
    console.say(
        f"{target}: {num_sweeps} sweeps of {recording.name}, {num_estimated} with an estimate of "
        f"{method}"
    )


def _exported_sweeps(
    recording: EvaluatedRecording, method: str, options: EvaluationOptions, console: Console
) -> Iterator[ExportedSweep]:
    """Yields the sweeps in stamp order, and tells of sweeps without an estimate and of damage."""
    stream = Stream(options.settings, method)
    options = options.for_methods([EvaluatedMethod(method, stream.traits)], pairs=True)
    findings, ground = Findings(), options.settings.ground
    following: tuple[Sweep, NDArray[np.float64]] | None = None

    def without_flow(sweep: Sweep, pose: NDArray[np.float64]) -> ExportedSweep:
        return ExportedSweep(sweep, ground_mask(sweep.xyz, ground), pose)

    for example in read_examples(recording, options, findings):
        current, truth = example.triplet.current, example.truth
        if following is not None and following[0].stamp_ns != current.stamp_ns:
            yield without_flow(*following)
        result = estimated(stream, example).result
        estimate = result if isinstance(result, FlowEstimate) else None
        if estimate is None:
            console.warn(f"no estimate at stamp {current.stamp_ns}: {result}")
        pose, motion = _poses(example, estimate)
        is_ground = ground_mask(current.xyz, ground) if truth is None else truth.ground
        interval_s = example.triplet.interval_s
        yield ExportedSweep(current, is_ground, pose, motion, interval_s, estimate, truth)
        following = example.triplet.next, pose @ np.linalg.inv(motion)
    if following is not None:
        yield without_flow(*following)
    for damage in findings.damages:
        console.warn(str(damage))


def _poses(
    example: Example, estimate: FlowEstimate | None
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    current, motion = example.triplet.current, example.triplet.next_from_current
    if current.odometry is not None and motion is not None:
        return current.odometry, motion
    if estimate is None or estimate.over_ground is None:
        raise DatasetError(
            f"{example.recording}: no pose at stamp {current.stamp_ns}; expected odometry, or a "
            "method that estimates the ego motion, such as online"
        )
    return estimate.over_ground.world_from_sensor, estimate.over_ground.next_from_current
