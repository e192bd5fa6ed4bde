# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""One task: one method on one recording. Tasks are independent of each other."""

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, field, replace
from itertools import islice
from typing import Final

import numpy as np

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError, plain_text
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import EvaluationOptions, EvaluationTask, TaskKey
from mnsf_ros.evaluation.outcomes import Outcome, attempted, estimated, replayed
from mnsf_ros.evaluation.pictures import Painter, Picture
from mnsf_ros.evaluation.scoring import ResultRow, failed_row, scored_row
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.methods import make_method
from mnsf_ros.settings import Settings
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet


@dataclass(frozen=True)
class FinishedTask:
    """End of one method on one recording, with events and damage."""

    recording: str
    method: str
    num_examples: int = 0
    counts: dict[str, int] = field(default_factory=dict)  # of events
    damages: list[str] = field(default_factory=list)  # parts that could not be read
    findings: dict[str, str] = field(default_factory=dict)  # violated assumptions on the input
    failure: str | None = None  # reason for giving up, in one line; a resumed run tries again

    @property
    def key(self) -> TaskKey:
        """Name of the recording and of the method."""
        return self.recording, self.method


TaskEvent = ResultRow | Picture | FinishedTask


def task_events(task: EvaluationTask, options: EvaluationOptions) -> Iterator[TaskEvent]:
    """Yields the events of one task; an MnsfError becomes the last event."""
    try:
        yield from run_task(task, options)
    except MnsfError as error:
        yield FinishedTask(*task.key, failure=str(error))


def run_task(task: EvaluationTask, options: EvaluationOptions) -> Iterator[TaskEvent]:
    """Evaluates one method on one recording.

    Yields:
        A row for each example at once, then pictures for a report, and at last a FinishedTask.

    Raises:
        MnsfError: The recording cannot be opened, or there is no such method.
    """
    recording, num_rows = task.recording, len(task.skipped)
    findings, stream = Findings(), Stream(options.settings, task.method.name)
    check = InputCheck(options.settings, findings.mounting, stream.rotation)
    findings.input_check = check
    if not stream.traits.is_external:
        warm_up(stream.method, options.settings)
    painter = Painter(options.pictures, is_animated=not stream.traits.is_reference)
    examples = read_examples(recording, options, findings)
    for outcome in _outcomes(stream, _chosen(examples, task, options), options.realtime):
        row = _row(outcome, stream)
        if isinstance(outcome.result, FlowEstimate):
            check.locate(Located.by(outcome.result, outcome.example.triplet.current))
        if isinstance(outcome.result, FlowEstimate) and row.failure is None:
            painter.add(row.badness_m, outcome.example, outcome.result)
        num_rows += 1
        yield row
    yield from painter.pictures(*task.key)
    damages = [plain_text(damage) for damage in findings.damages]
    counts = {event.value: number for event, number in findings.counts.items()}
    wrong = {one.assumption: str(one) for one in check.findings() if one.is_wrong}
    yield FinishedTask(*task.key, num_rows, counts, damages, wrong)


def _chosen(
    examples: Iterable[Example], task: EvaluationTask, options: EvaluationOptions
) -> Iterator[tuple[Example, bool]]:
    """Yields the examples that have no row yet, and whether each is scored."""
    for place, example in enumerate(islice(examples, options.every * options.max_examples or None)):
        if example.number not in task.skipped:
            yield example, place % options.every == 0


def _outcomes(
    stream: Stream, examples: Iterator[tuple[Example, bool]], realtime: float
) -> Iterator[Outcome]:
    if realtime:
        yield from replayed(stream, (example for example, _ in examples), realtime)
        return
    for example, is_scored in examples:
        if is_scored or stream.traits.carries_state:
            outcome = estimated(stream, example)
            if is_scored:
                yield outcome


def _row(outcome: Outcome, stream: Stream) -> ResultRow:
    example, result = outcome.example, outcome.result
    if isinstance(result, str):
        return failed_row(example, stream.method, result)
    time_ms = outcome.time_ms
    if not stream.traits.is_timed:
        time_ms = math.nan
    elif isinstance(result, FlowEstimate) and result.times_ms:
        # The sum of its stages: external programs report their time without their start.
        time_ms = result.time_ms
    row = attempted(lambda: scored_row(example, stream.method, result, time_ms))
    if isinstance(row, str):
        return failed_row(example, stream.method, row)
    return replace(row, latency_ms=outcome.latency_ms)


_FEW_STEPS: Final = {
    "optimization.max_iterations": 2,
    "fusion.max_iterations": 2,
    "warm_start.enabled": False,
    # The points of `warm_up` are near.
    "crop.min_range_m": 0.0,
}


def warm_up(method: str, settings: Settings) -> None:
    """Lets a method estimate a small triplet once, so that later times have no first calls.

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
