# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What the live node would have estimated, by arithmetic on measured run times."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from mnsf_ros.core.scene_flow_estimator import NUM_PREPARED_IN_ORDER
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.examples import Example

Prepared = TypeVar("Prepared")
Result = TypeVar("Result")
Job = TypeVar("Job")


@dataclass(frozen=True, eq=False)
class Outcome(Generic[Result]):
    """What became of an example.

    Attributes:
        example: The example.
        result: What the estimate gave; None if the example was dropped.
        time_ms: How long preparation and estimate took; NaN if dropped.
        latency_ms: From the arrival of its next sweep to the end of the estimate; NaN if dropped.
    """

    example: Example
    result: Result | None
    time_ms: float = math.nan
    latency_ms: float = math.nan


def played_in_real_time(
    examples: Iterable[Example],
    rate: float,
    prepare: Callable[[Example], tuple[Prepared, float]],
    estimate: Callable[[Example, Prepared], tuple[Result, float]],
) -> Iterator[Outcome[Result]]:
    """Estimates what the live node would have, and yields what became of every example.

    In the live node a triplet is prepared by one worker and estimated by another; some wait in
    front of each, and a newer one takes the place of the last of them. Here sweeps arrive by their
    stamps, at `rate` recorded seconds per second, and work takes the milliseconds that `prepare`
    and `estimate` give beside their results. Nothing actually waits, so equal run times give equal
    drops. That both workers share the cores of a computer is left out.

    Raises:
        EvaluationError: If the rate is not a number above 0.
    """
    if not 0 < rate < math.inf:
        raise EvaluationError(f"rate: got {rate!r}, expected a number above 0")
    dropped: list[Example] = []

    def prepared() -> Iterator[tuple[tuple[Example, float, Prepared, float], float]]:
        arrivals = (((example, now), now) for example, now in _arrivals(examples, rate))
        for (example, arrived_ms), done in _worked(
            arrivals, lambda job: prepare(job[0]), NUM_PREPARED_IN_ORDER
        ):
            if done is None:
                dropped.append(example)
            else:
                result, time_ms, end_ms = done
                yield (example, arrived_ms, result, time_ms), end_ms

    for (example, arrived_ms, _, time_ms), done in _worked(
        prepared(), lambda job: estimate(job[0], job[2]), 0
    ):
        if done is None:
            dropped.append(example)
        yield from (Outcome[Result](each, None) for each in dropped)
        dropped.clear()
        if done is not None:
            yield Outcome(example, done[0], time_ms + done[1], done[2] - arrived_ms)
    yield from (Outcome[Result](each, None) for each in dropped)


def _worked(
    arrivals: Iterable[tuple[Job, float]],
    work: Callable[[Job], tuple[Result, float]],
    num_in_order: int,
) -> Iterator[tuple[Job, tuple[Result, float, float] | None]]:
    """Works on jobs as a `LatestOnlyWorker` does.

    Yields each job with its result, its run time and when it was done; None if it was dropped.
    """
    idle_from_ms = -math.inf
    in_order: deque[tuple[Job, float]] = deque()
    newest: tuple[Job, float] | None = None

    def done(job: Job, arrived_ms: float) -> tuple[Job, tuple[Result, float, float]]:
        nonlocal idle_from_ms
        result, time_ms = work(job)
        idle_from_ms = max(idle_from_ms, arrived_ms) + time_ms
        return job, (result, time_ms, idle_from_ms)

    for job, now_ms in arrivals:
        while (in_order or newest is not None) and idle_from_ms <= now_ms:
            if in_order:
                yield done(*in_order.popleft())
            elif newest is not None:
                waiting, newest = newest, None
                yield done(*waiting)
        if idle_from_ms <= now_ms:
            yield done(job, now_ms)
        elif newest is None and len(in_order) < num_in_order:
            in_order.append((job, now_ms))
        else:
            if newest is not None:
                yield newest[0], None
            newest = job, now_ms
    for waiting in (*in_order, *([] if newest is None else [newest])):
        yield done(*waiting)


def _arrivals(examples: Iterable[Example], rate: float) -> Iterator[tuple[Example, float]]:
    """Each example with its time of arrival; the clock goes on where the recording jumps back."""
    arrival_ms, last_ns = 0.0, None
    for example in examples:
        stamp_ns = example.triplet.next.stamp_ns
        if last_ns is not None and stamp_ns < last_ns:
            last_ns = example.triplet.current.stamp_ns
        arrival_ms += (stamp_ns - (stamp_ns if last_ns is None else last_ns)) / 1e6 / rate
        last_ns = stamp_ns
        yield example, arrival_ms
