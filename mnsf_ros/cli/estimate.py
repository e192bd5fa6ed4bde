# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf estimate`: a recording in, a recording with its flow out."""

import argparse
from pathlib import Path

from mnsf_ros.cli.arguments import FORCE, Arguments, chosen_settings
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.cli.evaluate import EXIT_INCOMPLETE
from mnsf_ros.errors import RecordingError
from mnsf_ros.recording.bag_files import check_target
from mnsf_ros.recording.bag_reader import open_recording
from mnsf_ros.recording.bag_topics import used_topics


def add_estimate(arguments: Arguments) -> str:
    """Declares the arguments of `mnsf estimate`."""
    arguments.existing("bag", "recording")
    arguments.value(
        "--out OUT", "recording to write: a folder, or a file *.mcap", Path, required=True
    )
    arguments.value("--method NAME", "see docs/evaluation.md", default="online")
    arguments.settings(default="online")
    arguments.points()
    arguments.value("--odometry TOPIC", "sensor poses, with --set ego_motion.source=odometry")
    arguments.flag("--force", FORCE)
    return """\
OUT has the topics of the node: /scene_flow/flow (all points, with colours),
/scene_flow/flow/moving, /scene_flow/objects, /scene_flow/objects/markers,
/scene_flow/predicted, /scene_flow/ego_motion (poses with their covariance; no
twist) and, for each sweep, /scene_flow/ego_motion/source. Foxglove opens it
with the layout config/foxglove.json, beside the recording where its other
topics are wanted.

Example:
  mnsf estimate street --out street_flow.mcap

Exit status: 0: complete; 5: the recording is damaged, its readable part was estimated.
"""


def run_estimate(options: argparse.Namespace) -> int:
    """Writes the recording; returns the exit status."""
    source, target = Path(options.bag).resolve(), options.out.resolve()
    if source == target or source in target.parents or target in source.parents:
        raise RecordingError(f"{options.out}: is the recording that is read; --out is another path")
    check_target(options.out, overwrite=options.force)
    from mnsf_ros.evaluation.estimated_recording import write_estimated
    from mnsf_ros.stream.stream import Stream

    console = Console(stderr=True)
    with open_recording(options.bag, console.warn) as reader:
        topics = used_topics(options.bag, reader.topics, options.points, options.odometry)
        stream = Stream(chosen_settings(options), options.method)
        with counting_progress(console) as progress:
            task = progress.add_task(
                f"estimating {topics.points}", total=reader.topics[topics.points].count
            )
            written = write_estimated(
                reader,
                topics,
                options.out,
                stream,
                console.warn,
                lambda done: progress.update(task, completed=done),
                overwrite=options.force,
            )
    number, lost = written.num_flows, written.lost
    Console().say(f"{options.out}: {number} sweep{'s'[: number != 1]} with flow")
    if lost:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in lost.most_common())
        console.warn(f"the ego motion is lost in {lost.total()} of them: {reasons}")
    return 0 if written.is_whole else EXIT_INCOMPLETE
