# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One task: one method on one recording. Tasks know nothing of each other, so any may run them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import islice
from typing import Final

import numpy as np

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.flow_recording import Record, flow_recorder
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask
from mnsf_ros.evaluation.outcomes import Outcome, attempted, estimated, replayed
from mnsf_ros.evaluation.pictures import Painter, Picture
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.scoring import (
    cycle_distance,
    failed_row,
    reversed_pair,
    scored_row,
)
from mnsf_ros.methods import make_method
from mnsf_ros.online.stream import Stream
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet


@dataclass(frozen=True)
class TaskFailed:
    """A task gave up; why, in one line."""

    reason: str


TaskEvent = ResultRow | Picture | Findings | TaskFailed


def task_events(task: EvaluationTask, options: EvaluationOptions) -> Iterator[TaskEvent]:
    """Yields the events of one task; an error of ours becomes TaskFailed."""
    try:
        yield from run_task(task, options)
    except MnsfError as error:
        yield TaskFailed(str(error))


def run_task(task: EvaluationTask, options: EvaluationOptions) -> Iterator[TaskEvent]:
    """Evaluates one method on one recording.

    Yields:
        A row for each example as it gets ready, pictures for a report, and at the very end what was
        noticed.

    Raises:
        MnsfError: The recording cannot be opened, or there is no such method.
    """
    findings = Findings()
    recording = task.recording
    scorer = _Scorer(task.method.name, options)
    with (
        recording.open() as reader,
        flow_recorder(options.flow_folder, *task.key) as record,
    ):
        examples = islice(read_examples(reader, recording, options, findings), options.max_examples)
        wanted = (
            (example, options.is_scored(place))
            for place, example in enumerate(examples)
            if example.number not in task.skipped
        )
        yield from scorer.events(wanted, record)
    yield findings


class _Scorer:
    """Estimates and scores examples with one method."""

    def __init__(self, method: str, options: EvaluationOptions) -> None:
        self._method = method
        self._options = options
        self._stream = Stream(options.settings, method)
        self._traits = self._stream.traits
        if not self._traits.is_external:
            warm_up(method, options.settings)
        # Predictions that were read from files, whose time says nothing, have no way back.
        self._has_way_back = options.check_cycle and self._traits.is_timed
        self._backward: SceneFlowEstimator | None = None
        has_frames = not self._traits.is_reference
        self._painter = Painter(options.num_pictured, has_frames=has_frames)

    def events(
        self, examples: Iterator[tuple[Example, bool]], record: Record
    ) -> Iterator[ResultRow | Picture]:
        """Yields a row for each example to be scored, and pictures."""
        for outcome in self._outcomes(examples):
            example, estimate = outcome.example, outcome.result
            row = self._row(outcome)
            if isinstance(estimate, FlowEstimate) and row.failure is None:
                record(example, estimate.flow)
                yield from self._painter.frames(row, example, estimate)
            yield row
        yield from self._painter.worst()

    def _outcomes(self, examples: Iterator[tuple[Example, bool]]) -> Iterator[Outcome]:
        rate = self._options.realtime_rate
        if rate is not None:
            yield from replayed(self._stream, (example for example, _ in examples), rate)
            return
        for example, is_scored in examples:
            if is_scored or self._traits.carries_state:
                outcome = estimated(self._stream, example)
                if is_scored:
                    yield outcome

    def _row(self, outcome: Outcome) -> ResultRow:
        example, result = outcome.example, outcome.result
        if isinstance(result, str):
            return failed_row(example, self._method, result)
        row = attempted(
            lambda: scored_row(example, self._method, result, self._time_ms(outcome, result))
        )
        if isinstance(row, str):
            return failed_row(example, self._method, row)
        row = replace(row, latency_ms=outcome.latency_ms)
        return self._with_cycle(row, example, result)

    def _time_ms(self, outcome: Outcome, estimate: FlowEstimate) -> float:
        """The sum of its stages: a program that runs a network reports it without its start."""
        if not self._traits.is_timed:
            return math.nan
        return estimate.time_ms if estimate.times_ms else outcome.time_ms

    def _with_cycle(self, row: ResultRow, example: Example, result: FlowEstimate) -> ResultRow:
        if not self._has_way_back:
            return row
        triplet, looked_at = example.triplet, example.scored & np.isfinite(result.flow).all(axis=1)

        def cycle() -> dict[str, float]:
            way_back = self._way_back().estimate(reversed_pair(triplet))
            return cycle_distance(triplet, result.flow, way_back.flow, looked_at)

        found = attempted(cycle)
        return row if isinstance(found, str) else replace(row, consistency=row.consistency | found)

    def _way_back(self) -> SceneFlowEstimator:
        """An estimator of its own, which does not disturb the state of the other."""
        if self._backward is None or self._traits.carries_state:
            self._backward = make_method(self._method, self._options.settings)
        return self._backward


_FEW_STEPS: Final = {
    "optimization.max_iterations": 2,
    "fusion.max_iterations": 2,
    "warm_start.enabled": False,
    # The points below are near.
    "crop.min_range_m": 0.0,
}


def warm_up(method: str, settings: Settings) -> None:
    """Lets a method estimate a small triplet once; nothing of it is kept.

    Raises:
        SettingsError: There is no such method, or the settings do not suit it.
    """
    points = np.random.default_rng(0).uniform(-2.0, 2.0, (256, 3)).astype(np.float32)
    sweeps = [Sweep(points, stamp_ns=number * 100_000_000) for number in range(5)]
    triplet = SweepTriplet(
        previous=sweeps[2],
        current=sweeps[3],
        next=sweeps[4],
        earlier=(sweeps[1], sweeps[0]),
        next_from_current=np.eye(4),
    )
    estimator = make_method(method, settings.changed(_FEW_STEPS))
    attempted(lambda: estimator.estimate(triplet))
