# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Examination of a recording: what its sweeps are, and what of it does not fit the method."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

from mnsf_ros.ego_motion.ego_motion import EgoMotion, EgoSource
from mnsf_ros.errors import plain_text
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.tracks import Findings, recorded_sweeps, recorded_track
from mnsf_ros.geometry.pose_track import PoseTrack
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TF_TOPIC
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

_LEAST_SWEEPS: Final = 2


@dataclass(frozen=True)
class Examination:
    """What was found in a recording.

    Attributes:
        facts: Name to what the input is, in words.
        findings: What does not fit, the worst first.
        notes: What was noticed while it was read: damage, and events with their counts.
    """

    facts: dict[str, str]
    findings: list[Finding]
    notes: list[str]

    @property
    def is_wrong(self) -> bool:
        """Whether a finding harms the flow."""
        return any(one.is_wrong for one in self.findings)


def examined(
    recording: EvaluatedRecording, settings: Settings, max_duration_s: float
) -> Examination:
    """Reads the first sweeps of a recording, registers them, and checks the input.

    Raises:
        RecordingError: The recording cannot be read, or holds no sweep.
    """
    check = InputCheck(settings)
    findings = Findings(input_check=check)
    with BagReader(recording.path) as reader:
        sweeps = recorded_sweeps(reader, recording.points, recording.name, settings, findings)
        poses = recorded_track(reader, recording.odometry, settings, findings)
        about = _about(reader, recording)
        _register(_first(sweeps, max_duration_s), poses, settings, check)
    events = [f"{event.value}: {count:,}" for event, count in findings.counts.items()]
    damages = [plain_text(damage) for damage in (*recording.damages, *findings.damages)]
    found = check.findings()
    if check.num_sweeps < _LEAST_SWEEPS:
        text = f"clouds: {check.num_sweeps}, a flow needs {_LEAST_SWEEPS} in a row and more"
        found.insert(0, Finding("clouds come in a row", Severity.ERROR, text, "Record more"))
    return Examination(about | check.facts(), found, [*damages, *events])


def _about(reader: BagReader, recording: EvaluatedRecording) -> dict[str, str]:
    """The recording, and its poses, in words."""
    first_ns, last_ns = reader.span_ns
    length_s = (last_ns - first_ns) / NANOSECONDS
    checksums = "with" if reader.has_checksums else "without"
    poses = recording.odometry or "none named or found (--odometry)"
    if TF_TOPIC in reader.topics and recording.odometry is None:
        poses += f"; {TF_TOPIC} is recorded"
    return {
        "recording": f"{length_s:.1f} s, {checksums} checksums",
        "topic": f"{recording.points}, {recording.num_sweeps:,} clouds",
        "poses": poses,
    }


def _first(sweeps: Iterable[Sweep | None], max_duration_s: float) -> Iterator[Sweep]:
    """The sweeps until a time after the first one."""
    first_ns = None
    for sweep in filter(None, sweeps):
        first_ns = sweep.stamp_ns if first_ns is None else first_ns
        if sweep.stamp_ns - first_ns > max_duration_s * NANOSECONDS:
            return
        yield sweep


def _register(
    sweeps: Iterable[Sweep], poses: PoseTrack, settings: Settings, check: InputCheck
) -> None:
    """Locates sweeps by registration, also where odometry is known: it is judged by that."""
    ego_motion = EgoMotion(replace(settings.ego_motion, source=EgoSource.REGISTRATION.value))
    last_ns = -1
    for sweep in sweeps:
        if sweep.stamp_ns <= last_ns:
            continue
        last_ns = sweep.stamp_ns
        pose = poses.pose_at(sweep.stamp_ns)
        located = replace(sweep, odometry=None if pose is None else pose.world_from_frame)
        found = ego_motion.pose_of(located)
        check.locate(located, found.world_from_stamp, found.source.value)
