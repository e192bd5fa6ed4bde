# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Examination of a stream: properties of its clouds, and those that do not suit the method."""

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np

from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.errors import plain_text
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.tracks import recorded_clouds
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.input_check.finding import Finding, Severity
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.online.preparation import PreparedSweeps
from mnsf_ros.recording.bag_files import MCAP
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.bag_topics import TF_TOPIC
from mnsf_ros.recording.storage_file import Damage
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# In one of a hundred sweeps of random and adverse worlds (seeds 720 to 739, 3000 to 3015) the ego
# motion is lost among traffic, for a sweep or two.
_MAX_LOST_SHARE: Final = 0.05
_LEAST_CLOUDS: Final = 2


@dataclass(frozen=True)
class Examination:
    """Result of the examination of a stream."""

    facts: dict[str, str]  # properties of the input, by name
    findings: list[Finding]  # the worst first
    notes: list[str]  # further damage, and events with their counts

    @property
    def is_wrong(self) -> bool:
        """Whether a finding harms the flow."""
        return any(one.is_wrong for one in self.findings)


class Examiner:
    """Checks sweeps with the preparation of the method `online`.

    Attributes:
        check: Gets each cloud before its sweep is added.
        findings: For the reader of the sweeps.
    """

    def __init__(self, settings: Settings) -> None:
        # Odometry is judged by registration.
        source = {"ego_motion.source": EgoSource.REGISTRATION.value}
        self._stream = Stream(settings.changed(source), "online")
        self.check = InputCheck(settings, self._stream.mounting, self._stream.rotation)
        self.findings = Findings(mounting=self._stream.mounting, input_check=self.check)
        self._num_located = 0
        self._lost: list[tuple[float, str]] = []  # stamp in seconds, and why

    def add(self, sweep: Sweep) -> None:
        """Takes the next sweep."""
        self._stream.add(sweep)
        if self._stream.triplet is None:
            return
        prepared = self._stream.prepare(self._stream.triplet)
        if isinstance(prepared.content, PreparedSweeps):
            current = prepared.content.of_triplet[-2]
            sweep, pose = current.input, current.pose
            own_body = chosen_points(sweep.xyz, current.own)
            located = Located(sweep, pose.world_from_stamp, pose.source.value, own_body)
            self.check.locate(located)
            self._num_located += 1
            if pose.lost:
                self._lost.append((sweep.stamp_ns / NANOSECONDS, pose.lost))

    def examination(self, about: Mapping[str, str], notes: Iterable[str]) -> Examination:
        """Returns the result, with facts about the source of the clouds, and notes."""
        found, num_clouds = self.check.findings(), self.check.num_clouds
        if num_clouds < _LEAST_CLOUDS:
            text = f"clouds: {num_clouds}, a flow needs {_LEAST_CLOUDS} in a row and more"
            found.insert(0, Finding("clouds come in a row", Severity.ERROR, text, "Record more"))
        if self._lost:
            # What is wrong with the input is mostly its cause, and comes first.
            found.append(_lost_finding(self._lost, self._num_located))
            found.sort(key=lambda finding: -finding.severity)
        return Examination({**about, **self.check.facts()}, found, [*notes])


def examined(
    recording: EvaluatedRecording, settings: Settings, max_duration_s: float
) -> Examination:
    """Examines the first sweeps of a recording.

    Raises:
        RecordingError: The recording cannot be read, or holds no sweep.
    """
    examiner = Examiner(settings)
    findings = examiner.findings
    with BagReader(recording.path) as reader:
        about = _about(reader, recording)
        end_ns = np.inf
        for sweep in recorded_clouds(reader, recording.topics, settings, findings):
            end_ns = min(end_ns, sweep.stamp_ns + max_duration_s * NANOSECONDS)
            if sweep.stamp_ns > end_ns:
                about["topic"] += f", examined: the first {max_duration_s:g} s"
                break
            examiner.add(sweep)
    events = [f"{event.value}: {count:,}" for event, count in findings.counts.items()]
    damages = [*dict.fromkeys((*reader.damages, *findings.damages))]
    found = examiner.examination(about, (*map(plain_text, damages[1:]), *events))
    return replace(found, findings=[*_damage(damages), *found.findings])


def _lost_finding(lost: Sequence[tuple[float, str]], number: int) -> Finding:
    (first_s, _), reasons = lost[0], Counter(reason for _, reason in lost)
    text = ", ".join(f"{reason} ({count:,})" for reason, count in reasons.most_common())
    is_rare = len(lost) <= _MAX_LOST_SHARE * number
    return Finding(
        "the ego motion is known",
        Severity.INFO if is_rare else Severity.ERROR,
        f"the ego motion is lost in {len(lost):,} of {number:,} sweeps, first at {first_s:.3f} s: "
        f"{text}",
        "Check there for gaps between the clouds, a driver that repeats a cloud, and stamps; where "
        "too little stands around, take odometry (ego_motion.source). Meanwhile nothing counts as "
        "moving",
    )


def _damage(damages: Sequence[Damage]) -> Iterator[Finding]:
    if damages:
        more = f" (and {len(damages) - 1} more)" if len(damages) > 1 else ""
        text = f"the recording is damaged: {plain_text(damages[0])}{more}"
        remedy = "Record or copy it again; what can be read of it is used"
        if any(Path(damage.file).suffix == MCAP for damage in damages):
            remedy = "Copy it again, or repair it: `mcap recover` keeps what can be read"
        yield Finding("the recording is whole", Severity.ERROR, text, remedy)


def _about(reader: BagReader, recording: EvaluatedRecording) -> dict[str, str]:
    """The recording, and its poses, in words."""
    first_ns, last_ns = reader.span_ns
    length_s = (last_ns - first_ns) / NANOSECONDS
    # Without its index a file counts as one without checksums, which its chunks may have.
    checks = "with checksums" if reader.has_checksums else "without checksums"
    poses = recording.odometry or "none named or found (--odometry)"
    if TF_TOPIC in reader.topics and recording.odometry is None:
        poses += f"; {TF_TOPIC} is recorded"
    return {
        "recording": f"{length_s:.1f} s, {'damaged' if reader.damages else checks}",
        "topic": f"{recording.points}, {recording.num_sweeps:,} clouds",
        "poses": poses,
    }
