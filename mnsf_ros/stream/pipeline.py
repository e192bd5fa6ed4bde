# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A stream of sweeps whose halves run in worker threads, as does its output, and its statistics."""

import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from mnsf_ros.core.flow_estimate import Effort, FlowEstimate
from mnsf_ros.core.scene_flow_estimator import NUM_PREPARED_IN_ORDER
from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.errors import CancelledError, MnsfError
from mnsf_ros.settings import Settings
from mnsf_ros.stream.latest_only_worker import LatestOnlyWorker
from mnsf_ros.stream.load_control import LoadControl
from mnsf_ros.stream.stream import PreparedTriplet, Stream
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import Arrival

SWEEPS_RECEIVED = "sweeps_received"
TRIPLETS_FORMED = "triplets_formed"
TRIPLETS_DROPPED = "triplets_dropped"
TRIPLETS_UNWATCHED = "triplets_unwatched"
TRIPLETS_ABANDONED = "triplets_abandoned"
ESTIMATES_FAILED = "estimates_failed"
FLOWS_OUT = "flows_out"
OBJECTS_LEFT_OUT = "objects_left_out"
CALLBACK_ERRORS = "callback_errors"

# Each triplet that is formed is counted as one of these.
TRIPLET_ENDS = (
    FLOWS_OUT,
    TRIPLETS_DROPPED,
    ESTIMATES_FAILED,
    TRIPLETS_UNWATCHED,
    TRIPLETS_ABANDONED,
)

_WINDOW = 100
_NO_POINT = np.zeros(0, np.int64)
# Of an estimate that is under way when the settings change: a shorter one may end.
_ABANDONED_AFTER_S = 0.5


@dataclass(frozen=True)
class TripletJob:
    """A triplet that waits for its estimate."""

    triplet: SweepTriplet
    stream: Stream
    arrived_ns: int  # `time.monotonic_ns()`, when the newest sweep arrived


class StreamPipeline:
    """Takes sweeps as they come and hands out flows as they get ready.

    Two workers run the halves of a `Stream`: one prepares the sweeps of each triplet, the other one
    estimates; a third one hands out. So the next sweep is made ready while the last estimate is
    under way, and the flow before that is published. In front of the estimate one triplet waits,
    and a newer one takes its place: a triplet that is dropped there has cost its preparation, and
    no more. So does one flow in front of the output. In front of the preparation a few wait in
    order.

    `add_sweep`, `change_settings` and `reset` are for one thread only, that of the caller.
    `on_estimate` runs in the worker that hands out; an error in it counts as a failed estimate.
    `on_failure` runs there or in the worker that estimates.
    """

    def __init__(
        self,
        settings: Settings,
        on_estimate: Callable[[TripletJob, FlowEstimate], None],
        on_failure: Callable[[TripletJob, Exception], None],
    ) -> None:
        """Starts the workers. After a failure the next triplet is tried all the same.

        Raises:
            SettingsError: As of `Stream`.
        """
        self.statistics = StreamStatistics()
        self._stream = Stream(settings)
        self._load_control = LoadControl()
        self._on_estimate = on_estimate
        self._on_failure = on_failure
        self._handing_out = LatestOnlyWorker(self._hand_out, "output")
        self._estimating = LatestOnlyWorker(self._estimate, "estimator")
        self._preparing = LatestOnlyWorker(self._prepare, "preparation", NUM_PREPARED_IN_ORDER)
        # In the order of a sweep's way.
        self._workers = (self._preparing, self._estimating, self._handing_out)

    @property
    def load(self) -> int:
        """Triplets at hand: under preparation, being estimated or handed out, and those waiting."""
        # In this order: a triplet that goes on meanwhile is counted twice rather than not at all.
        return sum(worker.load for worker in self._workers)

    @property
    def mounting(self) -> MountingEstimate:
        """How the sensor is mounted."""
        return self._stream.mounting

    @property
    def rotation(self) -> LidarRotation:
        """Whether a lidar without times of points turns."""
        return self._stream.rotation

    def change_settings(self, settings: Settings) -> None:
        """Lets other settings hold from the next preparation on.

        One that is under way for long is abandoned: it could last for hours.

        Raises:
            SettingsError: As of `Stream.change_settings`; nothing changes then.
        """
        self._stream.change_settings(settings)

    def reset(self) -> None:
        """Forgets all sweeps and all state. An estimate under way is abandoned."""
        self._stream = Stream(self._stream.settings, after=self._stream)
        for worker in self._workers:
            if num_forgotten := worker.forget():
                self.statistics.count(TRIPLETS_ABANDONED, num_forgotten)

    def add_sweep(self, sweep: Sweep, arrived_ns: int, *, is_watched: bool = True) -> Arrival:
        """Takes the newest sweep and returns how it follows the last one, at once.

        It arrived at `time.monotonic_ns()`. If nobody watches the flow, it is only kept.
        """
        self.statistics.count(SWEEPS_RECEIVED)
        arrival = self._stream.add(sweep)
        if arrival is not Arrival.ACCEPTED:
            self.statistics.count(f"sweeps_{arrival.value}")
        triplet = self._stream.triplet
        if triplet is not None:
            self.statistics.count(TRIPLETS_FORMED)
            if not is_watched:
                self.statistics.count(TRIPLETS_UNWATCHED)
            elif self._preparing.submit(TripletJob(triplet, self._stream, arrived_ns)):
                self._count_drop()
        return arrival

    def close(self, timeout_s: float) -> bool:
        """Abandons the estimate under way and ends the workers.

        Returns False if one is still inside a library call that cannot be interrupted. It will
        hand out nothing any more.
        """
        deadline_s = time.monotonic() + timeout_s
        # The last one first: from now on nothing is handed on any more.
        for worker in reversed(self._workers):
            worker.close(0.0)
        return all(
            worker.close(max(0.0, deadline_s - time.monotonic())) for worker in self._workers
        )

    def _prepare(self, job: TripletJob) -> None:
        if self._estimating.submit((job, job.stream.prepare(job.triplet))):
            self._count_drop()

    def _estimate(self, work: tuple[TripletJob, PreparedTriplet]) -> None:
        job, prepared = work
        started_s = time.monotonic()

        def is_abandoned() -> bool:
            is_long = time.monotonic() - started_s > _ABANDONED_AFTER_S
            is_outdated = job.stream.settings is not prepared.settings and is_long
            is_reset = job.stream is not self._stream
            return self._estimating.is_closing or is_outdated or is_reset

        try:
            if is_abandoned():
                raise CancelledError("the triplet was abandoned")
            effort = self._load_control.effort if prepared.settings.compute.adapt else Effort.FULL
            estimate = job.stream.estimate(prepared, is_abandoned, effort)
        except CancelledError:
            self.statistics.count(TRIPLETS_ABANDONED)
        except Exception as error:  # noqa: BLE001 - one bad triplet must not end the stream
            self._fail(job, error)
        else:
            self._load_control.count_estimate()
            if self._handing_out.submit((job, estimate)):
                # A slow output is not made faster by less effort.
                self.statistics.count(TRIPLETS_DROPPED)

    def _hand_out(self, flow: tuple[TripletJob, FlowEstimate]) -> None:
        job, estimate = flow
        try:
            self._on_estimate(job, estimate)
        except Exception as error:  # noqa: BLE001 - as above
            self._fail(job, error)
        else:
            self.statistics.count(FLOWS_OUT)
            if estimate.num_left_out:
                self.statistics.count(OBJECTS_LEFT_OUT, estimate.num_left_out)
            latency_ms = (time.monotonic_ns() - job.arrived_ns) / 1e6
            self.statistics.add_estimate(latency_ms, estimate)

    def _count_drop(self) -> None:
        self.statistics.count(TRIPLETS_DROPPED)
        self._load_control.count_drop()

    def _fail(self, job: TripletJob, error: Exception) -> None:
        if self._estimating.is_closing:
            return
        self.statistics.count(ESTIMATES_FAILED)
        kind = "" if isinstance(error, MnsfError) else f"{type(error).__name__}: "
        self.statistics.add_failure(f"{kind}{error}")
        self._on_failure(job, error)


@dataclass(frozen=True)
class RecentEstimate:
    """Figures of one estimate."""

    latency_ms: float  # from the arrival of the next sweep to the publication of the flow
    estimate: FlowEstimate  # of no point

    @property
    def ego_source(self) -> str:
        """Source of the ego motion; empty if it is not known."""
        known = self.estimate.over_ground
        return "" if known is None else known.source

    @property
    def lost(self) -> str:
        """Why the ego motion is lost; empty if it is not, or is not estimated."""
        known = self.estimate.over_ground
        return "" if known is None else known.lost


@dataclass(frozen=True)
class StatisticsSnapshot:
    """The statistics at one moment; never changed."""

    counts: Counter[str] = field(default_factory=Counter)  # how often each event happened
    last_s: Mapping[str, float] = field(default_factory=dict)  # when, by `time.monotonic()`
    recent: tuple[RecentEstimate, ...] = ()  # oldest first
    last_failure: str = ""  # of an estimate; empty if there was none
    failures_in_a_row: int = 0  # since the last estimate that did not fail
    lost_since_s: float | None = None  # by `time.monotonic()`; None if the ego motion is known

    @property
    def lost(self) -> str:
        """Why the ego motion of the newest flow is lost; empty if it is not."""
        return self.recent[-1].lost if self.recent else ""

    def latency_ms(self, percentile: float) -> float:
        """Percentile of the recent latencies; NaN if there are none."""
        latencies = [item.latency_ms for item in self.recent]
        return float(np.percentile(latencies, percentile)) if latencies else float("nan")

    @property
    def estimate_ms(self) -> float:
        """Median run time of recent estimates; NaN if there are none."""
        times_ms = [item.estimate.time_ms for item in self.recent]
        return float(np.median(times_ms)) if times_ms else float("nan")


class StreamStatistics:
    """Counters and recent figures; may be used from any thread."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._now = StatisticsSnapshot()

    def count(self, event: str, times: int = 1) -> None:
        """Counts an event."""
        with self._lock:
            counts = self._now.counts + Counter({event: times})
            last_s = {**self._now.last_s, event: time.monotonic()}
            self._now = replace(self._now, counts=counts, last_s=last_s)

    def add_failure(self, text: str) -> None:
        """Notes that an estimate failed."""
        with self._lock:
            number = self._now.failures_in_a_row + 1
            self._now = replace(self._now, last_failure=text, failures_in_a_row=number)

    def add_estimate(self, latency_ms: float, estimate: FlowEstimate) -> None:
        """Notes that the flow of an estimate was published now."""
        item = RecentEstimate(latency_ms, estimate.part(_NO_POINT))
        with self._lock:
            recent = (*self._now.recent, item)[-_WINDOW:]
            since_s = (self._now.lost_since_s or time.monotonic()) if item.lost else None
            self._now = replace(self._now, recent=recent, failures_in_a_row=0, lost_since_s=since_s)

    def snapshot(self) -> StatisticsSnapshot:
        """All of it as of now."""
        return self._now
