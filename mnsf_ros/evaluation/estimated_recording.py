# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of a recording, as a recording with the topics of the node."""

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.ego_motion.covariance import UNKNOWN_COVARIANCE
from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.outcomes import pushed
from mnsf_ros.evaluation.tracks import recorded_clouds
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import UsedTopics
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.recording.messages import Messages
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import flow_cloud
from mnsf_ros.sweeps_io.movers_at_stamp import moving_cloud
from mnsf_ros.sweeps_io.predicted_ground import predicted_columns
from msg_utils.other_clouds import CLOUD_TYPE
from msg_utils.point_cloud2 import encode_columns

_NODE: Final = "/scene_flow"
# All sweeps may fail in the same way.
_MAX_WARNINGS: Final = 3


@dataclass(frozen=True)
class EstimatedRecording:
    """What was written.

    Attributes:
        num_flows: Number of sweeps with flow.
        lost: Why the ego motion was lost to the number of sweeps with flow where it was.
        is_whole: Whether the recording that was read is undamaged.
    """

    num_flows: int
    lost: Counter[str]
    is_whole: bool


def write_estimated(
    reader: BagReader,
    topics: UsedTopics,
    target: Path,
    stream: Stream,
    warn: Callable[[str], None],
    done: Callable[[int], None] = lambda _: None,
    *,
    overwrite: bool = False,
) -> EstimatedRecording:
    """Estimates the sweeps of a recording and writes to the target what the node would publish.

    Sweeps without flow and damaged parts are left out; `warn` gets a line for each. `done` gets the
    number of sweeps read so far.

    Raises:
        RecordingError: No sweep has a flow, or the target cannot be written.
    """
    findings, num_estimated, failures = Findings(), 0, list[str]()
    lost = Counter[str]()

    def fail(text: str) -> None:
        failures.append(text)
        if len(failures) <= _MAX_WARNINGS:
            warn(text)

    settings = stream.settings
    clouds = recorded_clouds(reader, topics, settings, findings)
    with BagWriter(target, overwrite=overwrite) as writer:
        for number, sweep in enumerate(clouds, start=1):
            done(number)
            if len(sweep) and (found := pushed(stream, sweep, fail)) is not None:
                _write(writer, *found, settings)
                num_estimated += 1
                if (known := found[1].over_ground) is not None and known.lost:
                    lost[known.lost] += 1
        if num_estimated == 0:
            reason = failures[-1] if failures else "three sweeps in a row are needed"
            raise RecordingError(f"{reader.path}: no sweep of {topics.points} has a flow: {reason}")
    if len(failures) > _MAX_WARNINGS:
        warn(f"and {len(failures) - _MAX_WARNINGS} more sweeps without flow")
    for damage in findings.damages:
        warn(str(damage))
    is_whole = not (reader.damages or findings.damages)
    return EstimatedRecording(num_estimated, lost, is_whole)


def _write(
    writer: BagWriter, triplet: SweepTriplet, estimate: FlowEstimate, settings: Settings
) -> None:
    sweep, known = triplet.current, estimate.over_ground
    stamp_ns, frame_id = sweep.stamp_ns, sweep.frame_id
    cloud = flow_cloud(sweep, estimate, triplet.interval_s, settings.output)
    writer.write_raw(f"{_NODE}/flow", CLOUD_TYPE, stamp_ns, cloud)
    if known is None:
        return
    moving = moving_cloud(triplet, estimate, known, settings)
    writer.write_raw(f"{_NODE}/flow/moving", CLOUD_TYPE, stamp_ns, moving)
    frames = settings.node.odom_frame, frame_id
    covariance = UNKNOWN_COVARIANCE if known.pose_covariance is None else known.pose_covariance
    writer.write_odometry(
        f"{_NODE}/ego_motion", known.world_from_sensor, stamp_ns, *frames, covariance=covariance
    )
    if settings.tf.broadcast:
        writer.write_transforms(stamp_ns, {frames: known.world_from_sensor})
    source = Messages("std_msgs").String(data=known.source)
    writer.write_message(f"{_NODE}/ego_motion/source", source, stamp_ns)
    if known.track_ids is not None:
        writer.write_objects(f"{_NODE}/objects", known.objects, stamp_ns, frame_id)
    if known.track_ids is not None and not known.lost:
        predicted = predicted_columns(known.objects, settings.output.horizon_s)
        encoded = encode_columns(predicted, 1, len(predicted["x"]))
        writer.write_cloud(f"{_NODE}/predicted", encoded, stamp_ns, frame_id)
