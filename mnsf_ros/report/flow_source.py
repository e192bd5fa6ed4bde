"""Examples of a run estimated once more, for pictures."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from contextlib import suppress

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.drawing.example_pictures import PicturedExample, PicturedFlow
from mnsf_ros.evaluation.examples import Example, read_examples
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.evaluation.options import (
    EvaluatedRecording,
    EvaluationOptions,
    choose_topics,
)
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.task import make_estimator
from mnsf_ros.recording.inspection import inspect_recording
from mnsf_ros.report.time_budget import TimeBudget


def estimated_examples(
    run: RunRecord,
    rows: Sequence[ResultRow],
    methods: Sequence[str],
    *,
    budget: TimeBudget | None = None,
    recordings: Iterable[EvaluatedRecording] | None = None,
) -> list[PicturedExample]:
    """Estimates examples once more, each from its sweeps alone.

    That gives the flow of the run once more, unless something was carried over there from one
    example to the next.

    Args:
        run: What was run.
        rows: The examples wanted, in this order.
        methods: With which methods, the most important one first; those that fail on an example
            are left out of it.
        budget: How long it may take; None for as long as it takes.
        recordings: Those of the run, if they are known; None to find out what is in them.

    Returns:
        The examples that have a flow.

    Raises:
        MnsfError: A recording cannot be read any more.
    """
    options, budget = run.identity.options(), budget or TimeBudget()
    if recordings is None:
        recordings = _recordings_of(run, {row.recording for row in rows})
    examples: dict[tuple[str, int], Example] = {}
    for recording in recordings:
        wanted = {row.number for row in rows if row.recording == recording.name}
        found = _examples(recording, options, wanted, budget) if wanted else ()
        examples.update({(example.recording, example.number): example for example in found})
    known = [examples[_key(row)] for row in rows if _key(row) in examples]
    pictured = [(example, _pictured(example)) for example in known]
    for method in methods:
        for example, picture in pictured:
            if budget.allows(method):
                # Methods are other people's code, too: a bug in one costs its own picture only.
                with suppress(Exception), budget.estimate(method):
                    picture.flows.append(_estimated(example, method, options))
    return [picture for _, picture in pictured if picture.flows]


def _estimated(example: Example, method: str, options: EvaluationOptions) -> PicturedFlow:
    estimator = make_estimator(method, options.method_settings)
    flow = estimator.estimate(example.triplet).flow
    return PicturedFlow(method, flow, _errors(example, flow), is_again=True)


def _recordings_of(run: RunRecord, names: set[str]) -> Iterable[EvaluatedRecording]:
    for record in run.recordings:
        if record.name in names:
            inspection = inspect_recording(record.path)
            topics = (record.points, record.truth, record.odometry)
            yield choose_topics(inspection, record.name, *topics)


def _examples(
    recording: EvaluatedRecording,
    options: EvaluationOptions,
    wanted: set[int],
    budget: TimeBudget,
) -> Iterable[Example]:
    left = set(wanted)
    with recording.inspection.open() as reader:
        for example in read_examples(reader, recording, options, Findings()):
            if example.number in left:
                yield example
                left.discard(example.number)
            if not left or budget.left_s <= 0:
                return


def _pictured(example: Example) -> PicturedExample:
    truth = example.truth
    return PicturedExample(
        recording=example.recording,
        number=example.number,
        stamp_ns=example.triplet.current.stamp_ns,
        xyz=example.triplet.current.xyz,
        truth=None if truth is None else _where_valid(truth.flow, truth.valid),
        next_from_current=example.next_from_current,
        error_name="distance to next sweep" if truth is None else "end point error",
    )


def _errors(example: Example, flow: NDArray[np.float32]) -> NDArray[np.float64]:
    truth = example.truth
    if truth is not None:
        return end_point_errors(flow, _where_valid(truth.flow, truth.valid))
    answered = np.isfinite(flow).all(axis=1)
    looked_at = answered if example.scored is None else answered & example.scored
    moved = example.triplet.current.xyz[looked_at] + flow[looked_at]
    distances = np.full(len(flow), np.nan)
    distances[looked_at], _ = cKDTree(example.triplet.next.xyz).query(moved)
    return distances


def _where_valid(flow: NDArray[np.float32], valid: NDArray[np.bool_]) -> NDArray[np.float32]:
    known: NDArray[np.float32] = np.where(valid[:, None], flow, np.float32(np.nan))
    return known


def _key(row: ResultRow) -> tuple[str, int]:
    return row.recording, row.number
