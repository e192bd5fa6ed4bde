# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""From a stream of sweeps to a stream of flows: buffer, two workers, estimator. No ROS in it."""

from __future__ import annotations

import logging
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from mnsf_ros.core.compute_device import check_device
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.memory_demand import check_memory
from mnsf_ros.core.scene_flow_estimator import (
    NUM_PREPARED_IN_ORDER,
    PreparingEstimator,
    SceneFlowEstimator,
)
from mnsf_ros.errors import CancelledError, MnsfError
from mnsf_ros.methods import load_method, make_method
from mnsf_ros.online.latest_only_worker import LatestOnlyWorker
from mnsf_ros.online.online_statistics import OnlineStatistics
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import Arrival, SweepBuffer

_LOG = logging.getLogger(__name__)

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

# Of an estimate that is under way when the settings change: a shorter one may end.
_ABANDONED_AFTER_S = 0.5


@dataclass(frozen=True)
class TripletJob:
    """A triplet that waits for its estimate."""

    triplet: SweepTriplet
    arrived_ns: int  # `time.monotonic_ns()`, when the newest sweep arrived
    num_resets: int = 0  # of the pipeline, until then


@dataclass(frozen=True, eq=False)
class _Plan:
    """How to estimate. Replaced as a whole, so that a change is another object."""

    settings: Settings
    num_resets: int = 0


@dataclass(frozen=True, eq=False)
class _PreparedJob:
    """A triplet on its way from the one worker to the other; never changed.

    Attributes:
        job: The triplet.
        estimator: Whose preparation it is.
        prepared: What the estimator made of the triplet; None if it prepares nothing.
        error: Why there is no flow for it.
    """

    job: TripletJob
    estimator: SceneFlowEstimator
    prepared: Any = None
    error: Exception | None = None


class OnlinePipeline:
    """Takes sweeps as they come and hands out flows as they get ready.

    Two workers: one prepares the sweeps of each triplet, where the method has that (see
    `PreparingEstimator`), the other one estimates. So the next sweep is made ready while the last
    estimate is under way. In front of the estimate one triplet waits, and a newer one takes its
    place: a triplet that is dropped there has cost its preparation, and no more. In front of the
    preparation a few wait in order.

    Who owns what:

    * The caller's thread (the executor's): the buffer, the plan and the settings that are to hold.
      `add_sweep`, `change_settings` and `reset` are for this one only.
    * The worker that estimates: the estimator, which it alone replaces, and the two callbacks.
    * Whoever holds the one lock, `_preparation`: the part of the estimator that prepares, and
      what is known of who did it last.

    An error in `on_estimate` counts as a failed estimate; one in `on_failure` is logged and
    counted.
    """

    def __init__(
        self,
        settings: Settings,
        on_estimate: Callable[[TripletJob, FlowEstimate], None],
        on_failure: Callable[[TripletJob, Exception], None],
    ) -> None:
        """Starts both workers. After a failure the next triplet is tried all the same.

        Raises:
            SettingsError: If the settings ask for a device that is not there, or for more memory
                than there is.
        """
        check_memory(settings)
        self.statistics = OnlineStatistics()
        self._plan = _Plan(settings)
        self._on_estimate = on_estimate
        self._on_failure = on_failure
        self._buffer = SweepBuffer()
        load_method(settings.method.name)
        self._estimator = make_method(settings.method.name, settings)
        self._estimator_plan = self._plan
        self._preparation = threading.Lock()
        # By which the worker that prepares has prepared last.
        self._prepared_by = self._estimator
        self._estimating = LatestOnlyWorker(self._estimate, "estimator")
        self._preparing = LatestOnlyWorker(self._prepare, "preparation", NUM_PREPARED_IN_ORDER)

    @property
    def load(self) -> int:
        """Triplets at hand: under preparation, being estimated, and waiting for either."""
        # In this order: a triplet that goes on meanwhile is counted twice rather than not at all.
        return self._preparing.load + self._estimating.load

    def change_settings(self, settings: Settings) -> None:
        """Applies other settings from the next estimate on; the method stays the same.

        A long estimate under way is abandoned: it could last for hours.

        Raises:
            SettingsError: If they ask for an unavailable device, or for more memory than there is;
                nothing changes then.
        """
        check_device(settings.compute)
        check_memory(settings)
        if settings != self._plan.settings:
            self._plan = _Plan(settings, self._plan.num_resets)

    def reset(self) -> None:
        """Forgets all sweeps and what was learned from them. An estimate under way is abandoned."""
        self._buffer.clear()
        self._plan = _Plan(self._plan.settings, self._plan.num_resets + 1)
        for worker in (self._preparing, self._estimating):
            if num_forgotten := worker.forget():
                self.statistics.count(TRIPLETS_ABANDONED, num_forgotten)

    def add_sweep(self, sweep: Sweep, arrived_ns: int, *, is_watched: bool = True) -> Arrival:
        """Takes the newest sweep and says what became of it. Returns at once.

        It arrived at `time.monotonic_ns()`. If nobody watches the flow, it is only kept.
        """
        self.statistics.count(SWEEPS_RECEIVED)
        self.statistics.add_arrival()
        arrival = self._buffer.push(sweep, self._plan.settings.buffer)
        if arrival is not Arrival.ACCEPTED:
            self.statistics.count(f"sweeps_{arrival.value}")
        triplet = self._buffer.triplet()
        if triplet is not None and triplet.next is sweep:
            self.statistics.count(TRIPLETS_FORMED)
            if not is_watched:
                self.statistics.count(TRIPLETS_UNWATCHED)
            elif self._preparing.submit(TripletJob(triplet, arrived_ns, self._plan.num_resets)):
                self.statistics.count(TRIPLETS_DROPPED)
        return arrival

    def close(self, timeout_s: float) -> bool:
        """Abandons the estimate under way and ends both workers.

        Returns False if one is still inside a library call that cannot be interrupted. It will
        hand out nothing any more.
        """
        deadline_s = time.monotonic() + timeout_s
        # From now on nothing is handed to it any more.
        self._estimating.close(0.0)
        workers = (self._preparing, self._estimating)
        return all(worker.close(max(0.0, deadline_s - time.monotonic())) for worker in workers)

    def _prepare(self, job: TripletJob) -> None:
        """Runs in the worker that prepares."""
        with self._preparation:
            prepared = _prepared(job, self._estimator)
            self._prepared_by = prepared.estimator
        if self._estimating.submit(prepared):
            self.statistics.count(TRIPLETS_DROPPED)

    def _estimate(self, prepared: _PreparedJob) -> None:
        """Runs in the worker that estimates."""
        plan, started_s, job = self._plan, time.monotonic(), prepared.job

        def is_abandoned() -> bool:
            is_long = time.monotonic() - started_s > _ABANDONED_AFTER_S
            is_outdated = self._plan is not plan and is_long
            is_reset = self._plan.num_resets != job.num_resets
            return self._estimating.is_closing or is_outdated or is_reset

        try:
            if is_abandoned():
                raise CancelledError("the triplet was abandoned")
            adapted = self._adapted(plan, prepared)
            if adapted is None:
                self.statistics.count(TRIPLETS_DROPPED)
                return
            estimate = _estimate(adapted, is_abandoned)
            if self._estimating.is_closing:
                return
            self._on_estimate(job, estimate)
        except CancelledError:
            self.statistics.count(TRIPLETS_ABANDONED)
        except Exception as error:  # noqa: BLE001 - one bad triplet must not end the stream
            self._fail(job, error)
        else:
            self.statistics.count(FLOWS_OUT)
            if estimate.num_left_out:
                self.statistics.count(OBJECTS_LEFT_OUT, estimate.num_left_out)
            latency_ms = (time.monotonic_ns() - job.arrived_ns) / 1e6
            self.statistics.add_estimate(latency_ms, estimate)

    def _adapted(self, plan: _Plan, prepared: _PreparedJob) -> _PreparedJob | None:
        """Returns the job prepared by an estimator that does what the plan says.

        None if a newer triplet was prepared with other settings meanwhile: sweeps can be prepared
        in their order only.
        """
        if plan is self._estimator_plan and prepared.estimator is self._estimator:
            return prepared
        with self._preparation:
            self._adapt(plan)
            is_overtaken = self._prepared_by is not prepared.estimator
            if is_overtaken and isinstance(self._estimator, PreparingEstimator):
                return None
            # Under the same lock: the worker that prepares goes on with the triplet after this one.
            return _prepared(prepared.job, self._estimator)

    def _adapt(self, plan: _Plan) -> None:
        old, settings = self._estimator_plan, plan.settings
        if plan.num_resets != old.num_resets:
            self._estimator = make_method(settings.method.name, settings)
        elif settings != old.settings:
            self._estimator = self._estimator.with_settings(settings)
        self._estimator_plan = plan

    def _fail(self, job: TripletJob, error: Exception) -> None:
        if self._estimating.is_closing:
            return
        self.statistics.count(ESTIMATES_FAILED)
        kind = "" if isinstance(error, MnsfError) else f"{type(error).__name__}: "
        self.statistics.add_failure(f"{kind}{error}")
        try:
            self._on_failure(job, error)
        except Exception:  # noqa: BLE001 - the next triplet is tried all the same
            self.statistics.count(CALLBACK_ERRORS)
            _LOG.exception("the callback for failed estimates raised an error")


def _prepared(job: TripletJob, estimator: SceneFlowEstimator) -> _PreparedJob:
    if not isinstance(estimator, PreparingEstimator):
        return _PreparedJob(job, estimator)
    try:
        return _PreparedJob(job, estimator, estimator.prepare(job.triplet))
    except Exception as error:  # noqa: BLE001 - it is told when it is the triplet's turn
        return _PreparedJob(job, estimator, error=error)


def _estimate(prepared: _PreparedJob, is_abandoned: Callable[[], bool]) -> FlowEstimate:
    estimator, triplet = prepared.estimator, prepared.job.triplet
    if prepared.error is not None:
        raise prepared.error
    if isinstance(estimator, PreparingEstimator):
        return estimator.estimate(triplet, is_abandoned, prepared.prepared)
    return estimator.estimate(triplet, is_abandoned)
