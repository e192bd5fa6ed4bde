# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Several lidars: groups of sweeps of one revolution as they arrive, and several clouds as one."""

from collections import deque
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import SimpleNamespace
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats, Floats32
from mnsf_ros.geometry.transforms import apply
from mnsf_ros.settings import LidarsSettings
from mnsf_ros.sweeps.mounting import Mounting
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep
from mnsf_ros.sweeps_io.flow_cloud import CloudSource, joined_rings
from msg_utils.point_cloud2 import decode_points, encode_columns
from msg_utils.point_times import PointTimes

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
    """Sweeps of one revolution, by the number of the lidar, from 0."""

    sweeps: dict[int, ArrivedSweep]  # the reference first
    clocks_ahead_s: dict[int, float]  # of lidars whose clock differs

    @property
    def reference(self) -> ArrivedSweep:
        """The sweep with the stamp of the group."""
        return next(iter(self.sweeps.values()))


class LidarGroups:
    """Groups each sweep of one lidar, the reference, with the nearest in time of each other one.

    The reference is the first lidar that works and has the clock of the majority. A lidar that
    sends nothing within the longest wait is left out until it sends again, one with another clock
    until the majority has that clock.
    """

    def __init__(self, num_lidars: int) -> None:
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
        self._silent: set[int] = set()
        self._odd: set[int] = set()  # have another clock
        self._last: dict[int, tuple[int, int]] = {}  # arrival and stamp of the last sweep
        self._heard_s: list[float] | None = None  # when each lidar has sent last
        self._last_reference = 0

    def add(self, index: int, item: ArrivedSweep, settings: LidarsSettings) -> None:
        """Adds a sweep of a lidar."""
        if self._heard_s is None:
            # The first one waits for the others as if they had just sent something.
            self._heard_s = [item.arrived_s] * len(self._queues)
        self._heard_s[index] = item.arrived_s
        self._last[index] = item.arrived_ns, item.sweep.stamp_ns
        queue = self._queues[index]
        if index in self._silent | self._odd:
            # No group waited for them, and they would come late.
            while queue and item.arrived_s - queue[0].arrived_s >= settings.max_wait_s:
                queue.popleft()
        self._silent.discard(index)
        queue.append(item)

    def due(self, now_s: float, settings: LidarsSettings) -> Iterator[LidarGroup]:
        """Yields the complete groups, in the order of the reference."""
        while (reference := self._reference(settings)) is not None:
            first = self._queues[reference][0]
            others = (index for index in self._working if index != reference)
            late = [index for index in others if self._may_come(index, first, settings)]
            if late and now_s - first.arrived_s < settings.max_wait_s:
                return
            self._silent.update(late)
            self._odd = set(self._working).difference(self._agreeing(settings))
            yield self._group(reference, first, settings)

    def _reference(self, settings: LidarsSettings) -> int | None:
        """The first working lidar with the clock of the majority, if it has a sweep."""
        while agreeing := self._agreeing(settings):
            first = agreeing[0]
            if self._queues[first]:
                return first
            if not self._is_silent(first, settings):
                return None
            self._silent.add(first)
        return None

    def _is_silent(self, index: int, settings: LidarsSettings) -> bool:
        """Whether another lidar has sent a sweep long after the last one of this lidar."""
        heard_s = self._heard_s or [0.0]
        return max(heard_s) - heard_s[index] >= settings.max_wait_s

    @property
    def _working(self) -> list[int]:
        return [index for index in range(len(self._queues)) if index not in self._silent]

    def _agreeing(self, settings: LidarsSettings) -> list[int]:
        """The largest set of working lidars with one clock; of equal ones the last choice."""
        near_ns = (settings.tolerance_s + settings.max_wait_s) * NANOSECONDS
        working = self._working
        sets = [[j for j in working if self._agree(i, j, near_ns)] for i in working]
        return max(sets, key=lambda some: (len(some), self._last_reference in some), default=[])

    def _agree(self, first: int, second: int, near_ns: float) -> bool:
        """Whether the last stamps are no further apart than the time between the arrivals."""
        if first not in self._last or second not in self._last:
            return True
        earlier, later = sorted((self._last[first], self._last[second]))
        passed_ns = later[0] - earlier[0]  # more than between the stamps in a slow replay
        return -near_ns <= later[1] - earlier[1] <= passed_ns + near_ns

    def _may_come(self, index: int, first: ArrivedSweep, settings: LidarsSettings) -> bool:
        """Whether the sweep nearest to the reference's may still arrive from a lidar."""
        if index in self._agreeing(settings):
            queue = self._queues[index]
            return not queue or queue[-1].sweep.stamp_ns < first.sweep.stamp_ns
        # All clocks may have been changed.
        return index not in self._odd and self._last[index][0] < first.arrived_ns

    def _group(self, reference: int, first: ArrivedSweep, settings: LidarsSettings) -> LidarGroup:
        stamp_ns = first.sweep.stamp_ns
        sweeps = {reference: first}
        for index, queue in enumerate(self._queues):
            if index == reference or not queue:
                continue
            nearest = min(queue, key=lambda item: abs(item.sweep.stamp_ns - stamp_ns))
            gap_s = abs(nearest.sweep.stamp_ns - stamp_ns) / NANOSECONDS
            if gap_s <= settings.tolerance_s:
                sweeps[index] = nearest
                while queue.popleft() is not nearest:
                    pass
            while queue and queue[0].sweep.stamp_ns < stamp_ns:
                queue.popleft()
        self._queues[reference].popleft()
        self._last_reference = reference
        clocks_s = {index: (last[1] - last[0]) / NANOSECONDS for index, last in self._last.items()}
        odd = (i for i in self._odd.difference(sweeps) if not self._is_silent(i, settings))
        ahead_s = {index: clocks_s[index] - clocks_s[reference] for index in odd}
        return LidarGroup(sweeps, ahead_s)


def merged_sweep(
    sweeps: Mapping[int, Sweep],
    frame_from_lidar: Mapping[int, Floats],
    stamp_ns: int,
    header: Any,  # noqa: ANN401 - std_msgs/Header
    mounting: Mounting | None = None,
) -> Sweep:
    """Returns the points of all sweeps in one frame, with a CloudSource as `source`.

    Fields of its cloud: x, y, z, `intensity` if all lidars have it, `time` (seconds after the
    stamp) unless all points have the same time, and `lidar`, counted from 1.

    Sweeps, each with a CloudSource, and poses (4, 4) in the common frame are by the number of the
    lidar, from 0. Stamp, header and mounting are for the merged sweep.
    """
    xyz = np.concatenate(
        [
            apply(frame_from_lidar[index], sweep.xyz).astype(np.float32)
            for index, sweep in sweeps.items()
        ]
    )
    numbers = np.fromiter((index + 1 for index in sweeps), np.uint8, len(sweeps))
    lidars = np.repeat(numbers, [len(sweep) for sweep in sweeps.values()])
    merged = _joined(list(sweeps.values()), xyz, stamp_ns, header, {"lidar": lidars})
    return replace(merged, mounting=mounting)


def revolution_sweep(parts: Sequence[Sweep]) -> Sweep:
    """Returns the parts of a revolution as one sweep with the stamp and header of the first.

    Each `source` is a CloudSource. The cloud is as of `merged_sweep`, with `ring` if known
    instead of `lidar`.
    """
    if len(parts) == 1:
        return parts[0]
    header = parts[0].source.message.header
    xyz, rings = np.concatenate([part.xyz for part in parts]), joined_rings(parts)
    further = {} if rings is None else {"ring": rings}
    return _joined(parts, xyz, parts[0].stamp_ns, header, further)


def _joined(
    sweeps: Sequence[Sweep],
    xyz: Floats32,
    stamp_ns: int,
    header: Any,  # noqa: ANN401 - std_msgs/Header
    further: Mapping[str, NDArray[Any]],
) -> Sweep:
    """The points (N, 3) of sweeps as one with a cloud, and further columns (N,)."""
    columns: dict[str, NDArray[Any]] = {
        axis: np.ascontiguousarray(xyz[:, number]) for number, axis in enumerate("xyz")
    }
    intensities = [values for sweep in sweeps if (values := _intensity(sweep)) is not None]
    if len(intensities) == len(sweeps):
        columns["intensity"] = np.concatenate(intensities)
    times_s = joined_times(sweeps, stamp_ns)
    if times_s is not None:
        columns["time"] = times_s
    # With the attributes of a sensor_msgs/PointCloud2.
    encoded = encode_columns({**columns, **further}, 1, len(xyz))
    cloud = SimpleNamespace(**vars(encoded), data=encoded.data, header=header)
    times = PointTimes(times_s, f"{sweeps[0].source.times.source}, of merged clouds")
    received_ns = sweeps[0].source.received_ns
    source = CloudSource(cloud, np.ones(len(xyz), np.bool_), times, received_ns=received_ns)
    return Sweep(xyz, stamp_ns, header.frame_id, source=source, times_s=times_s)


def joined_times(sweeps: Sequence[Sweep], stamp_ns: int) -> Floats32 | None:
    """Returns (N,) seconds after the common stamp; None if all points were measured at it."""
    if all(sweep.times_s is None and sweep.stamp_ns == stamp_ns for sweep in sweeps):
        return None
    parts = [
        (np.zeros(len(sweep)) if sweep.times_s is None else sweep.times_s.astype(np.float64))
        + (sweep.stamp_ns - stamp_ns) / NANOSECONDS
        for sweep in sweeps
    ]
    return np.concatenate(parts).astype(np.float32)


def _intensity(sweep: Sweep) -> Floats32 | None:
    """(N,) values of the field; None unless the cloud has one number for each point."""
    source: CloudSource = sweep.source
    points = decode_points(source.message).reshape(-1)
    if "intensity" not in (points.dtype.names or ()) or points["intensity"].ndim != 1:
        return None
    return np.compress(source.measured, points["intensity"]).astype(np.float32)
