"""Which triplets the live node would have dropped, simulated from measured run times.

In the live node a triplet waits in a single slot while another is being estimated, and a newer
one takes its place. Here sweeps arrive by their stamps and estimates take the measured time.
Nothing actually waits, so equal run times give equal drops.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import Generic, TypeVar

from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.examples import Example

Result = TypeVar("Result")


@dataclass(frozen=True, eq=False)
class Outcome(Generic[Result]):
    """What became of an example.

    Attributes:
        example: The example.
        result: What the estimate gave; None if the example was dropped.
        time_ms: How long the estimate took; NaN if dropped.
        latency_ms: From the arrival of its next sweep to the end of the estimate; NaN if dropped.
    """

    example: Example
    result: Result | None
    time_ms: float = math.nan
    latency_ms: float = math.nan


def played_in_real_time(
    examples: Iterable[Example], rate: float, estimate: Callable[[Example], tuple[Result, float]]
) -> Iterator[Outcome[Result]]:
    """Estimates what the live node would have, and yields what became of every example.

    Args:
        examples: In the order of their stamps.
        rate: Recorded seconds per second, as of a bag player; 1 is the robot's own time.
        estimate: Gives the result and how long it took, milliseconds.

    Raises:
        EvaluationError: If the rate is not a number above 0.
    """
    if not 0 < rate < math.inf:
        raise EvaluationError(f"rate: got {rate!r}, expected a number above 0")
    node = _Node(estimate)
    arrival_ms, last_ns = 0.0, None
    for example in examples:
        triplet = example.triplet
        stamp_ns = triplet.next.stamp_ns
        if last_ns is not None and stamp_ns < last_ns:
            # Time that jumps back in the recording goes on in the robot.
            last_ns = triplet.current.stamp_ns
        arrival_ms += (stamp_ns - (stamp_ns if last_ns is None else last_ns)) / 1e6 / rate
        last_ns = stamp_ns
        yield from node.arrive(example, arrival_ms)
    yield from node.finish()


class _Node(Generic[Result]):
    """The worker with its waiting slot."""

    def __init__(self, estimate: Callable[[Example], tuple[Result, float]]) -> None:
        self._estimate = estimate
        self._idle_from_ms = -math.inf
        self._waiting: tuple[Example, float] | None = None

    def arrive(self, example: Example, now_ms: float) -> Iterator[Outcome[Result]]:
        """Lets a triplet arrive."""
        if self._waiting is not None and self._idle_from_ms <= now_ms:
            yield self._started(*self._waiting)
            self._waiting = None
        if self._waiting is None and self._idle_from_ms <= now_ms:
            yield self._started(example, now_ms)
            return
        if self._waiting is not None:
            yield Outcome(self._waiting[0], None)
        self._waiting = example, now_ms

    def finish(self) -> Iterator[Outcome[Result]]:
        """Lets no more arrive."""
        if self._waiting is not None:
            yield self._started(*self._waiting)
            self._waiting = None

    def _started(self, example: Example, arrived_ms: float) -> Outcome[Result]:
        start_ms = max(self._idle_from_ms, arrived_ms)
        result, time_ms = self._estimate(example)
        self._idle_from_ms = start_ms + time_ms
        return Outcome(example, result, time_ms, self._idle_from_ms - arrived_ms)
