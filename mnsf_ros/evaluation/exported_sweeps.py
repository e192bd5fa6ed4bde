# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The sweeps of a recording, estimated for files of other projects."""

from collections.abc import Callable, Iterator

import numpy as np

from mnsf_ros.arrays import Floats
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.datasets.exported_sweep import ExportedSweep
from mnsf_ros.errors import DatasetError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.outcomes import estimated
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.ground_surface import ground_mask
from mnsf_ros.sweeps.sweep import Sweep


def exported_sweeps(
    recording: EvaluatedRecording,
    method: str,
    options: EvaluationOptions,
    warn: Callable[[str], None],
) -> Iterator[ExportedSweep]:
    """Yields the sweeps of a recording with the estimates of a method, in stamp order.

    `warn` gets a line for each sweep without an estimate.

    Raises:
        MnsfError: The method cannot be made, or the ego motion is not known.
    """
    stream = Stream(options.settings, method)
    options = options.for_methods([EvaluatedMethod(method, stream.traits)], pairs=True)
    ground = options.settings.ground
    following: tuple[Sweep, Floats] | None = None

    def without_flow(sweep: Sweep, pose: Floats) -> ExportedSweep:
        return ExportedSweep(sweep, ground_mask(sweep.xyz, ground), pose)

    for example in read_examples(recording, options, Findings()):
        current, truth = example.triplet.current, example.truth
        if following is not None and following[0].stamp_ns != current.stamp_ns:
            yield without_flow(*following)
        result = estimated(stream, example).result
        estimate = result if isinstance(result, FlowEstimate) else None
        if estimate is None:
            warn(f"no estimate for the {current}: {result}")
        pose, motion = _poses(example, estimate)
        is_ground = ground_mask(current.xyz, ground) if truth is None else truth.ground
        interval_s = example.triplet.interval_s
        yield ExportedSweep(current, is_ground, pose, motion, interval_s, estimate, truth)
        following = example.triplet.next, pose @ np.linalg.inv(motion)
    if following is not None:
        yield without_flow(*following)


def _poses(example: Example, estimate: FlowEstimate | None) -> tuple[Floats, Floats]:
    current, motion = example.triplet.current, example.triplet.next_from_current
    if current.odometry is not None and motion is not None:
        return current.odometry, motion
    if estimate is None or estimate.over_ground is None:
        raise DatasetError(
            f"{example.recording}: no pose for the {current}; expected odometry, or a "
            "method that estimates the ego motion, such as online"
        )
    return estimate.over_ground.world_from_sensor, estimate.over_ground.next_from_current
