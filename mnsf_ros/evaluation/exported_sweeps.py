# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The sweeps of a recording with the estimates of a method, for files of other projects."""

from __future__ import annotations

from collections.abc import Callable, Iterator

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.datasets.exported_sweep import ExportedFlow, ExportedSweep
from mnsf_ros.errors import DatasetError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluatedMethod, EvaluationOptions
from mnsf_ros.evaluation.outcomes import estimated
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.online.stream import Stream
from mnsf_ros.settings import GroundSettings
from mnsf_ros.sweeps.kept_points import ground_mask
from mnsf_ros.sweeps.sweep import Sweep


def exported_sweeps(
    recording: EvaluatedRecording,
    method: str,
    options: EvaluationOptions,
    warn: Callable[[str], None],
) -> Iterator[ExportedSweep]:
    """Yields the sweeps in stamp order, and tells of sweeps without an estimate and of damage.

    Poses and ground are those of the recording, else those of the method and of the settings.

    Raises:
        DatasetError: The pose of a sweep is not known.
        MnsfError: The recording cannot be read, or there is no such method.
    """
    stream = Stream(options.settings, method)
    options = options.for_methods([EvaluatedMethod(method, stream.traits)], pairs=True)
    findings = Findings()
    ground = options.settings.ground
    following: tuple[Sweep, NDArray[np.float64]] | None = None
    with recording.open() as reader:
        for example in read_examples(reader, recording, options, findings):
            current = example.triplet.current
            if following is not None and following[0].stamp_ns != current.stamp_ns:
                yield _exported(*following, ground)
            result = estimated(stream, example).result
            estimate = result if isinstance(result, FlowEstimate) else None
            if estimate is None:
                warn(f"no estimate at stamp {current.stamp_ns}: {result}")
            pose, motion = _poses(example, estimate)
            flow = ExportedFlow(
                current.xyz, motion, example.triplet.interval_s, estimate, example.truth
            )
            yield _exported(current, pose, ground, flow)
            following = example.triplet.next, pose @ np.linalg.inv(motion)
    if following is not None:
        yield _exported(*following, ground)
    for damage in findings.damages:
        warn(str(damage))


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


def _exported(
    sweep: Sweep,
    pose: NDArray[np.float64],
    settings: GroundSettings,
    flow: ExportedFlow | None = None,
) -> ExportedSweep:
    truth = None if flow is None else flow.truth
    return ExportedSweep(
        stamp_ns=sweep.stamp_ns,
        xyz=sweep.xyz,
        rows=sweep.source.rows,
        num_rows=sweep.source.num_points,
        ground=ground_mask(sweep.xyz, settings) if truth is None else truth.ground,
        pose=pose,
        motion=flow,
    )
