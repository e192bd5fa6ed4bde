# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Outcomes of examples in a stream: estimated one after the other, or replayed in real time."""

from __future__ import annotations

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any, TypeVar

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import NUM_PREPARED_IN_ORDER
from mnsf_ros.errors import MnsfError, one_line
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.results import DROPPED
from mnsf_ros.online.latest_only_worker import LatestOnlyQueue
from mnsf_ros.online.stream import Stream

_LOG = logging.getLogger(__name__)

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Outcome:
    """Outcome of an example.

    Attributes:
        example: The example.
        result: The estimate, or in one line why there is none.
        time_ms: Run time of preparation and estimate; NaN if dropped.
        latency_ms: From the arrival of its next sweep to the end of the estimate; NaN if dropped,
            or if not replayed in real time.
    """

    example: Example
    result: FlowEstimate | str
    time_ms: float = math.nan
    latency_ms: float = math.nan


def estimated(stream: Stream, example: Example) -> Outcome:
    """Estimates an example; the next one in turn."""
    result, time_ms = _timed(lambda: attempted(lambda: stream.flow_of(example.triplet)))
    return Outcome(example, result, time_ms)


def replayed(
    stream: Stream,
    examples: Iterable[Example],
    rate: float,
    clock_s: Callable[[], float] = time.perf_counter,
) -> Iterator[Outcome]:
    """Estimates what the live node would have, and yields the outcome of every example.

    As in the node one worker prepares and one estimates, each behind a `LatestOnlyQueue`. Their
    clock is virtual: sweeps arrive by their stamps, at `rate` recorded seconds per second, and work
    takes its run time by `clock_s`. Nothing actually waits, so equal run times give equal
    drops. That both workers share the cores of a computer is left out.
    """
    dropped: list[Example] = []

    def prepare(job: _Job) -> float:
        job.prepared, time_ms = _timed(lambda: stream.prepare(job.example.triplet), clock_s)
        job.time_ms = time_ms if job.prepared.is_prepared else 0.0
        return job.time_ms

    def estimate(job: _Job) -> float:
        work = partial(stream.estimate, job.prepared)
        job.result, time_ms = _timed(lambda: attempted(work), clock_s)
        job.time_ms += time_ms
        return time_ms

    def prepared() -> Iterator[tuple[_Job, float]]:
        for job, end_ms in _worked(_arrivals(examples, rate), prepare, NUM_PREPARED_IN_ORDER):
            if end_ms is None:
                dropped.append(job.example)
            else:
                yield job, end_ms

    for job, end_ms in _worked(prepared(), estimate, 0):
        if end_ms is None:
            dropped.append(job.example)
        yield from (Outcome(each, DROPPED) for each in dropped)
        dropped.clear()
        if end_ms is not None:
            yield Outcome(job.example, job.result, job.time_ms, end_ms - job.arrived_ms)
    yield from (Outcome(each, DROPPED) for each in dropped)


def attempted(work: Callable[[], Result]) -> Result | str:
    """The result of work, or in one line why it failed: one bad example must not end a run.

    Methods are other people's code, too, which may even call `sys.exit`.
    """
    try:
        return work()
    except MnsfError as error:
        return str(error)
    except (Exception, SystemExit) as error:  # noqa: BLE001 - see above
        _LOG.info("an example failed", exc_info=True)
        return one_line(error)


def _timed(
    work: Callable[[], Result], clock_s: Callable[[], float] = time.perf_counter
) -> tuple[Result, float]:
    start_s = clock_s()
    return work(), (clock_s() - start_s) * 1e3


@dataclass(eq=False)
class _Job:
    """An example on its way through both workers; times in ms, by the virtual clock."""

    example: Example
    arrived_ms: float
    time_ms: float = math.nan
    prepared: Any = None
    result: FlowEstimate | str = ""


def _worked(
    arrivals: Iterable[tuple[_Job, float]], work: Callable[[_Job], float], num_in_order: int
) -> Iterator[tuple[_Job, float | None]]:
    """Works on jobs that arrive at times; yields each with its end, None if it was dropped.

    `work` returns its run time.
    """
    idle_from_ms = -math.inf
    waiting: LatestOnlyQueue[tuple[_Job, float]] = LatestOnlyQueue(num_in_order)

    def done(job: _Job, arrived_ms: float) -> tuple[_Job, float]:
        nonlocal idle_from_ms
        time_ms = work(job)
        idle_from_ms = max(idle_from_ms, arrived_ms) + time_ms
        return job, idle_from_ms

    for job, now_ms in arrivals:
        while idle_from_ms <= now_ms and (first := waiting.take()) is not None:
            yield done(*first)
        if idle_from_ms <= now_ms:
            yield done(job, now_ms)
        elif (lost := waiting.put((job, now_ms))) is not None:
            yield lost[0], None
    while (first := waiting.take()) is not None:
        yield done(*first)


def _arrivals(examples: Iterable[Example], rate: float) -> Iterator[tuple[_Job, float]]:
    """Each example with its time of arrival; the clock goes on where the recording jumps back."""
    arrival_ms, last_ns = 0.0, None
    for example in examples:
        stamp_ns = example.triplet.next.stamp_ns
        if last_ns is not None and stamp_ns < last_ns:
            last_ns = example.triplet.current.stamp_ns
        arrival_ms += (stamp_ns - (stamp_ns if last_ns is None else last_ns)) / 1e6 / rate
        last_ns = stamp_ns
        yield _Job(example, arrival_ms), arrival_ms
