"""From sweeps, truth and poses to examples, one at a time: memory does not grow with length."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.evaluation.findings import ARRIVAL_EVENTS, Event, Findings
from mnsf_ros.evaluation.options import EvaluatedRecording, EvaluationOptions, PointSelection
from mnsf_ros.evaluation.tracks import (
    CloudRows,
    TruthTrack,
    in_stamp_order,
    recorded_poses,
    recorded_sweeps,
    truth_clouds,
)
from mnsf_ros.geometry.pose_track import PoseTrack
from mnsf_ros.geometry.rigid_motion import residual_flow
from mnsf_ros.geometry.transforms import sensor_mount
from mnsf_ros.recording.bag_reader import BagReader
from mnsf_ros.recording.flow_truth import FlowTruth
from mnsf_ros.settings import BufferSettings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import Arrival, SweepBuffer


@dataclass(frozen=True, eq=False)
class Example:
    """A triplet with what is known about the true flow of its current sweep.

    Attributes:
        recording: Name of the recording.
        number: Place of the current sweep in the recording, in stamp order, counted from 0.
        triplet: The sweeps as every method gets them: finite points, cropped, without ground,
            sampled if a number of points was asked for.
        truth: True flow of the points of the current sweep, row for row; None if unknown.
        next_from_current: (4, 4) rigid motion of the standing world from the current to the next
            sensor frame, from the recording's odometry; None if unknown.
        scored: (N,) bool, the points of the current sweep that figures are taken of, the same for
            all methods; None for all. Where a method prepares sweeps itself, it gets more than
            these.
    """

    recording: str
    number: int
    triplet: SweepTriplet
    truth: FlowTruth | None = None
    next_from_current: NDArray[np.float64] | None = None
    scored: NDArray[np.bool_] | None = None


# The paper's largest ablation uses five sweeps: t-3 to t+1.
MAX_SWEEPS: Final = 5
# Half of the points that stand are off by more where odometry and truth contradict each other.
_MAX_CONTRADICTION_M: Final = 0.1


def read_examples(
    reader: BagReader,
    recording: EvaluatedRecording,
    options: EvaluationOptions,
    findings: Findings,
) -> Iterator[Example]:
    """Yields the examples of an open recording in stamp order.

    Args:
        reader: The recording.
        recording: Which of its topics to use.
        options: Which points and triplets to use.
        findings: Gets what is noticed on the way.
    """
    truth = poses = None
    if recording.truth is not None:
        clouds = truth_clouds(reader, recording.truth, findings)
        truth = TruthTrack(clouds, findings, str(reader.path))
    if recording.odometry is not None:
        recorded = recorded_poses(reader, recording.odometry, findings)
        poses = PoseTrack(recorded, sensor_mount(options.settings.ego_motion))
    builder = ExampleBuilder(
        recording.name,
        options.selection,
        options.settings.buffer,
        findings,
        truth=truth,
        poses=poses,
        num_sweeps=options.num_sweeps_in(recording),
    )
    sweeps = recorded_sweeps(reader, recording.points, recording.name, findings)
    return builder.examples(in_stamp_order(sweeps))


@dataclass(frozen=True, eq=False)
class SelectedSweep:
    """A sweep as the methods get it, with what is known about its points.

    Attributes:
        sweep: The points that were selected.
        number: Place of the sweep in the recording, counted from 0.
        scored: (N,) bool, the points that figures are taken of.
        truth: Truth of the same points, row for row; None if unknown.
        world_from_sensor: (4, 4) pose of the sensor; None if unknown.
    """

    sweep: Sweep
    number: int
    scored: NDArray[np.bool_]
    truth: FlowTruth | None = None
    world_from_sensor: NDArray[np.float64] | None = None


class ExampleBuilder:
    """Puts sweeps that come in stamp order together to examples."""

    def __init__(
        self,
        recording: str,
        selection: PointSelection,
        settings: BufferSettings,
        findings: Findings,
        *,
        truth: TruthTrack | None = None,
        poses: PoseTrack | None = None,
        num_sweeps: int = 3,
    ) -> None:
        """Starts without any sweep.

        Args:
            recording: Name of the recording.
            selection: Which points to give and to score.
            settings: Which sweeps may stand beside each other.
            findings: Gets what is noticed on the way.
            truth: Truth of the sweeps; None if there is none.
            poses: Poses of the sensor; None if there are none.
            num_sweeps: Sweeps that an example must have, 2 to `MAX_SWEEPS`.
        """
        self._recording = recording
        self._selection = selection
        self._settings = settings
        self._findings = findings
        self._truth = truth
        self._poses = poses
        self._num_sweeps = num_sweeps
        self._number = 0
        self._buffer = SweepBuffer()
        self._recent: deque[SelectedSweep] = deque(maxlen=MAX_SWEEPS)

    def examples(self, sweeps: Iterable[Sweep | None]) -> Iterator[Example]:
        """Yields the examples of a recording.

        Args:
            sweeps: All finite points of each sweep, `source` a CloudRows; None where sweeps may
                be missing.
        """
        for sweep in sweeps:
            if sweep is None:
                self._interrupt()
                continue
            selected = self._selected(sweep)
            if self._is_accepted(selected):
                example = self._newest_example()
                if example is not None:
                    yield example

    def _interrupt(self) -> None:
        """Lets no triplet reach across this place."""
        self._findings.count(Event.INTERRUPTIONS, int(len(self._recent) > 0))
        self._buffer = SweepBuffer()
        self._recent.clear()

    def _selected(self, sweep: Sweep) -> SelectedSweep:
        truth = self._truth_of(sweep)
        cloud: CloudRows = sweep.source
        if truth is not None:
            truth = truth.of_points(cloud.rows)
        scored = self._selection.scored_mask(sweep.xyz, None if truth is None else truth.ground)
        rows = self._selection.given_rows(scored, sweep.stamp_ns)
        if truth is not None:
            truth = replace(truth, valid=truth.valid & scored).of_points(rows)
        source = replace(cloud, rows=cloud.rows[rows])
        number, self._number = self._number, self._number + 1
        pose = self._pose_of(sweep)
        return SelectedSweep(
            sweep=replace(sweep, xyz=sweep.xyz[rows], source=source, odometry=pose),
            number=number,
            scored=scored[rows],
            truth=truth,
            world_from_sensor=pose,
        )

    def _truth_of(self, sweep: Sweep) -> FlowTruth | None:
        if self._truth is None:
            return None
        truth, passed_over = self._truth.take(sweep)
        self._findings.count(Event.TRUTH_WITHOUT_SWEEP, passed_over)
        if passed_over and self._recent and self._recent[-1].truth is not None:
            # The truth before leads to a sweep that is not there, and must not be scored.
            self._interrupt()
        self._findings.count(Event.SWEEPS_WITHOUT_TRUTH, int(truth is None))
        return truth

    def _pose_of(self, sweep: Sweep) -> NDArray[np.float64] | None:
        if self._poses is None:
            return None
        pose = self._poses.pose_at(sweep.stamp_ns)
        if pose is None:
            self._findings.count(Event.SWEEPS_WITHOUT_POSE)
            return None
        self._findings.count(Event.FRAMES_DIFFER, int(pose.frame_id not in ("", sweep.frame_id)))
        return pose.world_from_frame

    def _is_accepted(self, selected: SelectedSweep) -> bool:
        arrival = self._buffer.push(selected.sweep, self._settings)
        if arrival is not Arrival.ACCEPTED:
            self._findings.count(ARRIVAL_EVENTS[arrival])
        if arrival in (Arrival.DUPLICATE, Arrival.OUT_OF_ORDER):
            return False
        if arrival is not Arrival.ACCEPTED:
            self._recent.clear()
        self._recent.append(selected)
        return True

    def _newest_example(self) -> Example | None:
        if len(self._recent) < self._num_sweeps:
            return None
        *before, current, following = self._recent
        sweeps_before = [selected.sweep for selected in reversed(before)]
        motion = _motion(current, following)
        if motion is not None and current.truth is not None:
            contradicts = _contradicts(motion, current.sweep.xyz, current.truth)
            self._findings.count(Event.ODOMETRY_CONTRADICTS, int(contradicts))
        return Example(
            recording=self._recording,
            number=current.number,
            triplet=SweepTriplet(
                previous=sweeps_before[0] if sweeps_before else None,
                current=current.sweep,
                next=following.sweep,
                earlier=tuple(sweeps_before[1:]),
                next_from_current=motion,
            ),
            truth=current.truth,
            next_from_current=motion,
            scored=current.scored,
        )


def _motion(current: SelectedSweep, following: SelectedSweep) -> NDArray[np.float64] | None:
    if current.world_from_sensor is None or following.world_from_sensor is None:
        return None
    motion: NDArray[np.float64] = (
        np.linalg.inv(following.world_from_sensor) @ current.world_from_sensor
    )
    return motion


def _contradicts(motion: NDArray[np.float64], xyz: NDArray[np.float32], truth: FlowTruth) -> bool:
    stands = truth.valid & ~truth.dynamic
    if not stands.any():
        return False
    off_m = np.linalg.norm(residual_flow(xyz[stands], truth.flow[stands], motion), axis=1)
    return float(np.median(off_m)) > _MAX_CONTRADICTION_M
