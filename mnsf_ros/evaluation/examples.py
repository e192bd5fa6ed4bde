# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Examples from sweeps, truth and poses, one at a time: memory does not grow with length."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from mnsf_ros.arrays import Bools, Floats, Floats32
from mnsf_ros.errors import plain_text
from mnsf_ros.evaluation.findings import Event, Findings
from mnsf_ros.evaluation.options import MAX_SWEEPS, EvaluationOptions, num_sweeps_needed
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.tracks import recorded_sweeps, recorded_track
from mnsf_ros.evaluation.truth_track import TruthTrack, truth_clouds
from mnsf_ros.geometry.pose_track import PoseTrack
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.sweeps.kept_points import crop_mask, kept_mask
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import REFUSED, Arrival, SweepBuffer


@dataclass(frozen=True, eq=False)
class Example:
    """A triplet with the true flow of its current sweep, if known.

    Its sweeps have all measured points, as in the live node; `kept` of each is from `kept_points`.
    """

    recording: str  # name
    number: int  # index of the current sweep in the recording
    triplet: SweepTriplet
    truth: FlowTruth | None = None  # of all points of the current sweep, row for row

    @property
    def scored(self) -> Bools:
        """The points (N,) of the current sweep that are scored, the same for all methods."""
        current = self.triplet.current
        return np.ones(len(current), dtype=bool) if current.kept is None else current.kept


def read_examples(
    recording: EvaluatedRecording, options: EvaluationOptions, findings: Findings
) -> Iterator[Example]:
    """Yields the examples of a recording, which gets its damage; `findings` collect events, too.

    Raises:
        RecordingError: The recording cannot be read.
    """
    settings, truth, poses = options.settings, None, None
    num_sweeps = num_sweeps_needed(options, recording.num_sweeps)
    with BagReader(recording.path) as reader:
        if recording.truth is not None:
            clouds = truth_clouds(reader, recording.truth, findings)
            truth = TruthTrack(clouds, findings, str(reader.path))
        if recording.odometry is not None:
            poses = recorded_track(reader, recording.odometry, settings, findings)
        builder = ExampleBuilder(options, findings, truth=truth, poses=poses, num_sweeps=num_sweeps)
        sweeps = recorded_sweeps(reader, recording.points, recording.name, settings, findings)
        try:
            yield from builder.examples(sweeps)
        finally:
            texts = map(plain_text, findings.damages)
            recording.damages.extend(text for text in texts if text not in recording.damages)


def kept_points(
    xyz: Floats32, stamp_ns: int, true_ground: Bools | None, options: EvaluationOptions
) -> Bools:
    """Returns a mask (N,) of the points to estimate and score, the same for all methods.

    `xyz` is (N, 3) metres, levelled. Each stamp has its own random choice, the same in each run.
    """
    settings = options.settings
    if settings.ground.remove and options.ground == "truth" and true_ground is not None:
        kept = crop_mask(xyz, settings.crop) & ~true_ground
    else:
        kept = kept_mask(xyz, settings)
    rows = np.flatnonzero(kept)
    if 0 < options.num_points < len(rows):
        random = np.random.default_rng([options.seed, stamp_ns])
        kept[:] = False
        kept[random.choice(rows, options.num_points, replace=False)] = True
    return kept


class ExampleBuilder:
    """Puts sweeps together to examples."""

    def __init__(
        self,
        options: EvaluationOptions,
        findings: Findings,
        *,
        truth: TruthTrack | None = None,
        poses: PoseTrack | None = None,
        num_sweeps: int = 3,
    ) -> None:
        """Starts without any sweep; an example must have `num_sweeps` sweeps, 2 to `MAX_SWEEPS`."""
        self._options = options
        self._findings = findings
        self._truth = truth
        self._poses = poses
        self._buffer = SweepBuffer(MAX_SWEEPS, num_sweeps)
        self._num_sweeps = 0
        # Number and truth of the newest sweep in the buffer.
        self._newest: tuple[int, FlowTruth | None] = (0, None)

    def examples(self, sweeps: Iterable[Sweep | None]) -> Iterator[Example]:
        """Yields the examples of sweeps as from `recorded_sweeps`."""
        for sweep in sweeps:
            if sweep is None:
                self._interrupt()
            elif (example := self._completed_by(sweep)) is not None:
                yield example

    def _interrupt(self) -> None:
        """Makes the next triplet start after this place."""
        self._findings.count(Event.INTERRUPTIONS, int(len(self._buffer) > 0))
        self._buffer.clear()

    def _completed_by(self, sweep: Sweep) -> Example | None:
        number, self._num_sweeps = self._num_sweeps, self._num_sweeps + 1
        truth = self._truth_of(sweep)
        sweep = self._findings.mounting.mounted(sweep, self._options.settings)
        self._findings.count(Event.LEVELLED, int(sweep.tilt is not None))
        ground = None if truth is None else truth.ground
        kept = kept_points(sweep.levelled.xyz, sweep.stamp_ns, ground, self._options)
        source, odometry = sweep.source.without_messages, self._pose_of(sweep)
        sweep = replace(sweep, source=source, kept=kept, odometry=odometry)
        arrival, triplet = self._buffer.push(sweep, self._options.settings.buffer)
        if arrival is not Arrival.ACCEPTED:
            self._findings.count(Event[arrival.name])
        if arrival in REFUSED:
            return None
        current, self._newest = self._newest, (number, truth)
        if triplet is None:
            return None
        triplet = replace(triplet, next_from_current=_motion(triplet.current, sweep))
        return Example(sweep.source.recording, current[0], triplet, truth=current[1])

    def _truth_of(self, sweep: Sweep) -> FlowTruth | None:
        if self._truth is None:
            return None
        truth, num_skipped = self._truth.take(sweep)
        self._findings.count(Event.TRUTH_WITHOUT_SWEEP, num_skipped)
        if num_skipped and len(self._buffer) and self._newest[1] is not None:
            # The truth of the last sweep leads to a sweep that is missing.
            self._interrupt()
        self._findings.count(Event.SWEEPS_WITHOUT_TRUTH, int(truth is None))
        return truth

    def _pose_of(self, sweep: Sweep) -> Floats | None:
        if self._poses is None:
            return None
        pose = self._poses.pose_at(sweep.stamp_ns)
        if pose is None:
            self._findings.count(Event.SWEEPS_WITHOUT_POSE)
            return None
        self._findings.count(Event.FRAMES_DIFFER, int(pose.frame_id not in ("", sweep.frame_id)))
        return pose.world_from_frame


def _motion(current: Sweep, following: Sweep) -> Floats | None:
    if current.odometry is None or following.odometry is None:
        return None
    return np.linalg.inv(following.odometry) @ current.odometry
