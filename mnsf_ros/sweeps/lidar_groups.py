# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Groups of sweeps of several lidars that belong to the same revolution, as they arrive."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

from mnsf_ros.settings import LidarsSettings
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep

# Sweeps of most lidars within the longest wait; each is some megabytes.
_MAX_SWEEPS: Final = 12


@dataclass(frozen=True, eq=False)
class ArrivedSweep:
    """A sweep and its time of arrival: nanoseconds of a steady clock."""

    sweep: Sweep
    arrived_ns: int

    @property
    def arrived_s(self) -> float:
        """Time of arrival in seconds."""
        return self.arrived_ns / NANOSECONDS


@dataclass(frozen=True, eq=False)
class LidarGroup:
    """Sweeps of one revolution: number of the lidar, from 0, to its sweep, the reference first."""

    sweeps: dict[int, ArrivedSweep]

    @property
    def reference(self) -> ArrivedSweep:
        """The sweep with the stamp of the group."""
        return next(iter(self.sweeps.values()))


class LidarGroups:
    """Groups each sweep of one lidar, the reference, with the nearest in time of each other one.

    The reference is the first lidar that works. A lidar that sends nothing within the longest wait
    is left out until it sends a sweep of the others' time; so a lidar that fails, or has another
    clock, does not stop the others.
    """

    def __init__(self, num_lidars: int) -> None:
        """Starts without a sweep."""
        self._queues: list[deque[ArrivedSweep]] = [
            deque(maxlen=_MAX_SWEEPS) for _ in range(num_lidars)
        ]
        self.clear()

    @property
    def is_waiting(self) -> bool:
        """Whether some sweeps are not in a group yet."""
        return any(self._queues)

    def clear(self) -> None:
        """Forgets all sweeps and all lidars left out."""
        for queue in self._queues:
            queue.clear()
        self._left_out: set[int] = set()
        self._heard_s: list[float] | None = None  # when each lidar has sent last
        self._last_ns: int | None = None  # of the last group

    def add(self, index: int, item: ArrivedSweep, settings: LidarsSettings) -> None:
        """Adds a sweep of a lidar."""
        if self._heard_s is None:
            # The first one waits for the others as if they had just sent something.
            self._heard_s = [item.arrived_s] * len(self._queues)
        self._heard_s[index] = item.arrived_s
        if index in self._left_out:
            self._queues[index].clear()
            near_s = settings.tolerance_s + settings.max_wait_s
            if self._last_ns is None or _gap_s(item.sweep.stamp_ns, self._last_ns) <= near_s:
                self._left_out.remove(index)
        self._queues[index].append(item)

    def due(self, now_s: float, settings: LidarsSettings) -> Iterator[LidarGroup]:
        """Yields the complete groups, in the order of the reference."""
        while (reference := self._reference(settings)) is not None:
            first = self._queues[reference][0]
            late = [index for index in self._others(reference) if self._may_come(index, first)]
            if late and now_s - first.arrived_s < settings.max_wait_s:
                return
            self._left_out.update(late)
            yield self._group(reference, first, settings)

    def _reference(self, settings: LidarsSettings) -> int | None:
        """The first lidar that works, if it has a sweep."""
        for index, queue in enumerate(self._queues):
            if index in self._left_out:
                continue
            if queue:
                return index
            if not self._is_silent(index, settings):
                return None
            self._left_out.add(index)
        # Those left out did not fit to the one that is silent now: the first that sends goes on.
        sending = [index for index, queue in enumerate(self._queues) if queue]
        if not sending:
            return None
        self._left_out.remove(sending[0])
        return sending[0]

    def _is_silent(self, index: int, settings: LidarsSettings) -> bool:
        """Whether another lidar has sent a sweep long after the last one of this lidar."""
        heard_s = self._heard_s or [0.0]
        return max(heard_s) - heard_s[index] >= settings.max_wait_s

    def _others(self, reference: int) -> list[int]:
        return [
            index
            for index in range(len(self._queues))
            if index != reference and index not in self._left_out
        ]

    def _may_come(self, index: int, first: ArrivedSweep) -> bool:
        """Whether the sweep nearest to the reference's may still arrive from a lidar."""
        queue = self._queues[index]
        return not queue or queue[-1].sweep.stamp_ns < first.sweep.stamp_ns

    def _group(self, reference: int, first: ArrivedSweep, settings: LidarsSettings) -> LidarGroup:
        stamp_ns = first.sweep.stamp_ns
        sweeps = {reference: first}
        for index, queue in enumerate(self._queues):
            if index == reference or not queue:
                continue
            nearest = min(queue, key=lambda item: abs(item.sweep.stamp_ns - stamp_ns))
            if _gap_s(nearest.sweep.stamp_ns, stamp_ns) <= settings.tolerance_s:
                sweeps[index] = nearest
                while queue.popleft() is not nearest:
                    pass
            while queue and queue[0].sweep.stamp_ns < stamp_ns:
                queue.popleft()
        self._queues[reference].popleft()
        self._last_ns = stamp_ns
        return LidarGroup(sweeps)


def _gap_s(first_ns: int, second_ns: int) -> float:
    return abs(first_ns - second_ns) / NANOSECONDS
