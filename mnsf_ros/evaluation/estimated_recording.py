# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of a recording, as a recording with the topics of the node."""

from collections.abc import Callable
from pathlib import Path
from typing import Final

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.ego_motion.covariance import UNKNOWN_COVARIANCE
from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.outcomes import pushed
from mnsf_ros.evaluation.tracks import Findings, recorded_clouds
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import CLOUD_TYPE
from mnsf_ros.recording.bag_writer import BagWriter
from mnsf_ros.settings import OutputSettings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import SweepTriplet
from mnsf_ros.sweeps_io.flow_cloud import flow_cloud

_NODE: Final = "/scene_flow"
# All sweeps may fail in the same way.
_MAX_TOLD: Final = 3


def write_estimated(
    reader: BagReader,
    topic: str,
    target: Path,
    stream: Stream,
    warn: Callable[[str], None],
    done: Callable[[int], None] = lambda _: None,
    *,
    overwrite: bool = False,
) -> int:
    """Estimates the sweeps of a topic and writes what the node would publish. Returns how many.

    Sweeps without flow are left out and damage is read around; `warn` gets a line for each.

    Args:
        reader: The recording.
        topic: Of its clouds.
        target: The recording to write.
        stream: Estimates them.
        warn: Gets a line.
        done: Gets the number of sweeps read so far.
        overwrite: Whether to replace a recording at the target.

    Raises:
        RecordingError: No sweep has a flow, or the target cannot be written.
    """
    findings, num_estimated, failures = Findings(), 0, list[str]()

    def fail(text: str) -> None:
        failures.append(text)
        if len(failures) <= _MAX_TOLD:
            warn(text)

    clouds = recorded_clouds(reader, topic, stream.settings, findings)
    with BagWriter(target, overwrite=overwrite) as writer:
        for number, sweep in enumerate(clouds, start=1):
            done(number)
            if sweep is None or len(sweep) == 0:
                continue
            if (found := pushed(stream, sweep, fail)) is not None:
                _write(writer, *found, stream.settings.node.odom_frame)
                num_estimated += 1
        if num_estimated == 0:
            reason = failures[-1] if failures else "three sweeps in a row are needed"
            raise RecordingError(f"{reader.path}: no sweep of {topic} has a flow: {reason}")
    if len(failures) > _MAX_TOLD:
        warn(f"and {len(failures) - _MAX_TOLD} more sweeps without flow")
    for damage in findings.damages:
        warn(str(damage))
    return num_estimated


def _write(
    writer: BagWriter, triplet: SweepTriplet, estimate: FlowEstimate, odom_frame: str
) -> None:
    sweep, known = triplet.current, estimate.over_ground
    stamp_ns, frame_id = sweep.stamp_ns, sweep.frame_id
    parts = {"flow": None} if known is None else {"flow": None, "flow/moving": known.dynamic}
    for name, part in parts.items():
        cloud = flow_cloud(sweep, estimate, triplet.interval_s, OutputSettings(), part)
        writer.write_raw(f"{_NODE}/{name}", CLOUD_TYPE, stamp_ns, cloud)
    if known is None:
        return
    pose = known.world_from_sensor
    covariance = UNKNOWN_COVARIANCE if known.pose_covariance is None else known.pose_covariance
    writer.write_odometry(
        f"{_NODE}/ego_motion", pose, stamp_ns, odom_frame, frame_id, covariance=covariance
    )
    if known.track_ids is not None:
        writer.write_objects(f"{_NODE}/objects", known.objects, stamp_ns, frame_id)
