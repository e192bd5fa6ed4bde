# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sweeps of a recording with their flow: the estimate, the truth and the error as scenes."""

from collections.abc import Callable, Iterator, Sequence
from itertools import count
from typing import Final, NamedTuple

import numpy as np

from mnsf_ros.arrays import Bools, Floats
from mnsf_ros.core.flow_estimate import FlowEstimate, TrackedObject
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.outcomes import pushed
from mnsf_ros.evaluation.scoring import true_motion
from mnsf_ros.evaluation.tracks import recorded_sweeps
from mnsf_ros.evaluation.truth_track import TruthTrack, truth_clouds
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import UsedTopics
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S
from mnsf_ros.view.scene_message import Colors, DrawnSweep, error_colors, motion_colors


class EstimatedSweep(NamedTuple):
    """A triplet with the truth and the estimate of its current sweep."""

    example: Example
    estimate: FlowEstimate


def estimated_sweeps(
    reader: BagReader, topics: UsedTopics, stream: Stream, warn: Callable[[str], None]
) -> Iterator[EstimatedSweep]:
    """Yields the sweeps of a topic.

    Sweeps without flow are left out and damage is read around; `warn` gets a line for each.

    Raises:
        RecordingError: Damage leaves nothing with a flow.
    """
    findings, name = Findings(), str(reader.path)
    clouds = () if topics.truth is None else truth_clouds(reader, topics.truth, findings)
    truth = TruthTrack(clouds, findings, name)
    numbers = count(-1)
    num_warned = num_estimates = 0
    for sweep in recorded_sweeps(reader, topics.points, name, stream.settings, findings):
        for damage in [*findings.damages][num_warned:]:
            warn(str(damage))
            num_warned += 1
        if sweep is None or len(sweep) == 0:
            continue
        number = next(numbers)
        found = pushed(stream, sweep, warn)
        if found is None:
            continue
        triplet, estimate = found
        num_estimates += 1
        known, _ = truth.take(triplet.current)
        yield EstimatedSweep(Example(name, number, triplet, known), estimate)
    if findings.damages and num_estimates == 0:
        raise next(iter(findings.damages)).error()


def scene_of(sweep: EstimatedSweep, layer: str) -> DrawnSweep:
    """Returns a sweep as it is drawn, in the colours of a layer: estimate, truth or error."""
    current = sweep.example.triplet.current
    return DrawnSweep(
        current.stamp_ns, current.xyz, _COLORS[layer](sweep), *pose_and_objects(sweep)
    )


def pose_and_objects(sweep: EstimatedSweep) -> tuple[Floats, Sequence[TrackedObject]]:
    """Returns world_from_sensor (4, 4), the identity if unknown, and the dynamic objects."""
    known = sweep.estimate.over_ground
    return (np.eye(4), ()) if known is None else (known.world_from_sensor, known.objects)


def _estimate_colors(sweep: EstimatedSweep) -> Colors:
    estimate, known = sweep.estimate, sweep.estimate.over_ground
    motion = estimate.flow if known is None else known.motion
    dynamic = np.zeros(len(motion), np.bool_) if known is None else known.dynamic
    interval_s = sweep.example.triplet.interval_s or USUAL_INTERVAL_S
    return motion_colors(motion / np.float32(interval_s), dynamic)


def _truth_colors(sweep: EstimatedSweep) -> Colors:
    example = sweep.example
    velocity = np.zeros_like(sweep.estimate.flow)
    moves: Bools = np.zeros(len(velocity), np.bool_)
    if (truth := example.truth) is not None and truth.valid.any():
        moves = truth.dynamic & truth.valid
        rows = np.flatnonzero(truth.valid)
        motion, _ = true_motion(example, truth, rows)
        velocity[rows] = motion.velocity
        velocity[~moves] = 0.0
    return motion_colors(velocity, moves)


def _colors_of_errors(sweep: EstimatedSweep) -> Colors:
    truth, flow = sweep.example.truth, sweep.estimate.flow
    if truth is None:
        return error_colors(flow[:, 0], np.zeros(len(flow), np.bool_))
    return error_colors(np.linalg.norm(flow - truth.flow, axis=1), truth.valid)


_COLORS: Final = {"estimate": _estimate_colors, "truth": _truth_colors, "error": _colors_of_errors}
LAYERS: Final = tuple(_COLORS)
