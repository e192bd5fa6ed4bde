# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Outcomes of examples in a stream: estimated one after the other, or replayed in real time."""

import logging
import math
import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Any, TypeVar

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import NUM_PREPARED_IN_ORDER
from mnsf_ros.errors import MnsfError, is_caused_by, one_line
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.scoring import DROPPED
from mnsf_ros.stream.latest_only_worker import LatestOnlyQueue
from mnsf_ros.stream.stream import Stream
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep, SweepTriplet

_LOG = logging.getLogger(__name__)

Result = TypeVar("Result")


@dataclass(eq=False)
class Outcome:
    """Outcome of an example; times are NaN if it is dropped."""

    example: Example
    result: FlowEstimate | str = DROPPED  # the estimate, or the reason for its absence in one line
    time_ms: float = math.nan  # run time of preparation and estimate
    latency_ms: float = math.nan  # from the arrival of its next sweep on, if replayed in real time


def estimated(stream: Stream, example: Example) -> Outcome:
    """Estimates an example; the next one in turn."""
    start_s = time.perf_counter()
    result = attempted(lambda: stream.flow_of(example.triplet))
    return Outcome(example, result, (time.perf_counter() - start_s) * 1e3)


def pushed(
    stream: Stream, sweep: Sweep, warn: Callable[[str], None]
) -> tuple[SweepTriplet, FlowEstimate] | None:
    """Adds the newest sweep to a stream.

    Returns the triplet that it completes, with its flow; None without one. `warn` gets a line if
    there is no flow for the triplet.
    """
    try:
        estimate = stream.push(sweep)
    except MnsfError as error:
        warn(f"no flow at {sweep.stamp_ns / NANOSECONDS:.3f} s: {error}")
        return None
    triplet = stream.triplet
    return None if estimate is None or triplet is None else (triplet, estimate)


def attempted(work: Callable[[], Result]) -> Result | str:
    """Returns the result of work, or its failure in one line: a bad example must not end a run.

    Methods may be other people's code, which even calls `sys.exit`. An interruption is passed on,
    also if a library turned it into another error.
    """
    try:
        return work()
    except MnsfError as error:
        return str(error)
    except (Exception, SystemExit) as error:
        if is_caused_by(error, KeyboardInterrupt):
            raise KeyboardInterrupt from error
        _LOG.info("an example failed", exc_info=True)
        return one_line(error)


@dataclass(eq=False)
class _Job:
    """An example on its way through both workers; times in ms, by the virtual clock."""

    outcome: Outcome
    arrived_ms: float
    prepared: Any = None


def replayed(
    stream: Stream,
    examples: Iterable[Example],
    rate: float,
    clock_s: Callable[[], float] = time.perf_counter,
) -> Iterator[Outcome]:
    """Estimates the examples that the live node would estimate, and yields an outcome for each.

    As in the node one worker prepares and one estimates, each behind a `LatestOnlyQueue`. Their
    clock is virtual: sweeps arrive by their stamps, at `rate` recorded seconds per second, and work
    takes its run time by `clock_s`. Nothing actually waits, so equal run times give equal drops.
    The workers do not compete for cores.
    """

    def prepare(job: _Job) -> float:
        start_s = clock_s()
        job.prepared = stream.prepare(job.outcome.example.triplet)
        time_ms = (clock_s() - start_s) * 1e3
        job.outcome.time_ms = time_ms if job.prepared.is_prepared else 0.0
        return job.outcome.time_ms

    def estimate(job: _Job) -> float:
        start_s = clock_s()
        job.outcome.result = attempted(lambda: stream.estimate(job.prepared))
        time_ms = (clock_s() - start_s) * 1e3
        job.outcome.time_ms += time_ms
        return time_ms

    dropped: list[_Job] = []
    arrivals = _arrivals(examples, rate)
    prepared = _worked(arrivals, prepare, NUM_PREPARED_IN_ORDER, dropped)
    for job, end_ms in _worked(prepared, estimate, 0, dropped):
        yield from (Outcome(each.outcome.example) for each in dropped)
        dropped.clear()
        job.outcome.latency_ms = end_ms - job.arrived_ms
        yield job.outcome
    yield from (Outcome(each.outcome.example) for each in dropped)


def _worked(
    arrivals: Iterable[tuple[_Job, float]],
    work: Callable[[_Job], float],
    num_in_order: int,
    dropped: list[_Job],
) -> Iterator[tuple[_Job, float]]:
    """Yields jobs and when each ends by the run times of `work`; `dropped` gets the others."""
    idle_from_ms = -math.inf
    waiting: LatestOnlyQueue[tuple[_Job, float]] = LatestOnlyQueue(num_in_order)

    def done_by(now_ms: float) -> Iterator[tuple[_Job, float]]:
        nonlocal idle_from_ms
        while idle_from_ms <= now_ms and (first := waiting.take()) is not None:
            job, arrived_ms = first
            idle_from_ms = max(idle_from_ms, arrived_ms) + work(job)
            yield job, idle_from_ms

    for job, now_ms in arrivals:
        yield from done_by(now_ms)
        if (lost := waiting.put((job, now_ms))) is not None:
            dropped.append(lost[0])
        yield from done_by(now_ms)
    yield from done_by(math.inf)


def _arrivals(examples: Iterable[Example], rate: float) -> Iterator[tuple[_Job, float]]:
    """Yields examples with their times of arrival; the clock goes on if a recording jumps back."""
    arrival_ms, last_ns = 0.0, None
    for example in examples:
        stamp_ns = example.triplet.next.stamp_ns
        if last_ns is not None and stamp_ns < last_ns:
            last_ns = example.triplet.current.stamp_ns
        arrival_ms += (stamp_ns - (stamp_ns if last_ns is None else last_ns)) / 1e6 / rate
        last_ns = stamp_ns
        yield _Job(Outcome(example), arrival_ms), arrival_ms
