# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A stream of sweeps to a stream of flows. Live and offline, everything goes through here."""

import threading
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from mnsf_ros.core.compute_device import check_device
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.scene_flow_estimator import (
    MethodTraits,
    PreparingEstimator,
    SceneFlowEstimator,
    never,
)
from mnsf_ros.errors import OvertakenError, SettingsError
from mnsf_ros.methods import make_method
from mnsf_ros.presets import settings_for
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import Start, Stretch, Sweep, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import Arrival, SweepBuffer

_STARTS: Final = {
    Arrival.GAP: Start.COLD_GAP,
    Arrival.FRAME_CHANGED: Start.COLD_FRAME,
    Arrival.OUT_OF_ORDER: Start.COLD_TIME_JUMP,
    Arrival.TIME_WENT_BACK: Start.COLD_TIME_JUMP,
}


@dataclass(frozen=True, eq=False)
class PreparedTriplet:
    """A triplet between the two halves of its estimate; never changed.

    Attributes:
        triplet: The triplet, with the stretch of the stream that it is part of.
        estimator: The owner of the preparation.
        content: The preparation; None if the estimator prepares nothing.
        error: Why there is no flow for it.
    """

    triplet: SweepTriplet
    estimator: SceneFlowEstimator
    content: Any = None
    error: BaseException | None = None

    @property
    def is_prepared(self) -> bool:
        """Whether there was anything to prepare."""
        return self.content is not None or self.error is not None


class Stream:
    """Takes sweeps in the order of time and gives the flow of the one before the newest.

    It owns what continuity means: which sweeps form a triplet (`SweepBuffer`), and whether a method
    may build on the triplets before (`Stretch`). A stretch ends where time goes back, `frame_id`
    changes, the stream is reset, or the method gets no triplet for longer than its `max_gap_s`.

    `push` does everything in one thread. Its three parts may also have one thread each: `add`,
    `prepare` and `estimate`. `prepare` takes triplets in their order; those that are dropped
    between two parts are simply not handed on. `change_settings` and `reset` are for the thread
    that adds.

    Attributes:
        triplet: The triplet that the newest sweep completes, if any.
        settings: They hold from the next estimate on.
    """

    def __init__(self, settings: Settings, method: str = "") -> None:
        """Starts without any sweep. `method` defaults to the settings' `method.name`.

        Raises:
            SettingsError: There is no such method, or the settings ask for a device that is not
                there.
            LibraryError: The method needs a library that is not installed.
        """
        self.settings = settings
        self.method: Final = method or settings.method.name
        self.triplet: SweepTriplet | None = None
        # Of the triplets that are formed; breaks between them are found when they are prepared.
        self._since_reset = Stretch()
        self._estimator = make_method(self.method, settings)
        self._buffer = SweepBuffer(num_kept=self._estimator.traits.num_sweeps)
        self._adapted_to = settings
        # The estimator as it was before the newest triplet, see `repeat`.
        self._before: SceneFlowEstimator | None = None
        # Guards what follows, and the part of the estimator that prepares.
        self._preparation = threading.Lock()
        self._prepared_by = self._estimator
        self._last: SweepTriplet | None = None
        self._stretch = Stretch()

    @property
    def traits(self) -> MethodTraits:
        """Properties of the method."""
        return self._estimator.traits

    def push(self, sweep: Sweep, cancelled: Callable[[], bool] = never) -> FlowEstimate | None:
        """Adds the newest sweep. Returns the flow of the one before it, None without a triplet.

        Raises:
            MnsfError: There is no flow for this triplet; the stream goes on.
        """
        self.add(sweep)
        if self.triplet is None:
            return None
        if isinstance(self._estimator, PreparingEstimator):
            self._before = self._with_settings(self._estimator, self._adapted_to)
        return self.flow_of(self.triplet, cancelled)

    def repeat(self, cancelled: Callable[[], bool] = never) -> FlowEstimate | None:
        """The flow of the last push again, with the settings that hold by now.

        Earlier sweeps keep what was estimated then. None before the first flow, and for methods
        that cannot go back.

        Raises:
            MnsfError: There is no flow for this triplet; the stream goes on.
        """
        if self._before is None or self.triplet is None:
            return None
        self._estimator = self._with_settings(self._before, self.settings)
        self._adapted_to = self.settings
        return self.flow_of(self.triplet, cancelled)

    def flow_of(self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never) -> FlowEstimate:
        """Both halves of the estimate of a triplet, one after the other.

        Raises:
            MnsfError: There is no flow for this triplet; the stream goes on.
        """
        return self.estimate(self.prepare(triplet), cancelled)

    def add(self, sweep: Sweep) -> Arrival:
        """Adds the newest sweep to the buffer, see `triplet`. Returns how it follows the last."""
        arrival, triplet = self._buffer.push(sweep, self.settings.buffer)
        self.triplet = None if triplet is None else replace(triplet, stretch=self._since_reset)
        return arrival

    def change_settings(self, settings: Settings) -> None:
        """Lets other settings hold from the next estimate on. The method stays.

        Raises:
            SettingsError: If they ask for another method, for a device that is not there, or for
                more memory than there is; nothing changes then.
        """
        if settings.method != self.settings.method:
            raise SettingsError(
                f"method.name: got {settings.method.name!r}, expected "
                f"{self.settings.method.name!r}: the method of a running stream is fixed"
            )
        check_device(settings.compute)
        if settings != self.settings:
            self.settings = settings

    def reset(self) -> None:
        """Forgets all sweeps; the next triplet starts from scratch."""
        self._buffer.clear()
        self.triplet = None
        self._since_reset = Stretch()

    def is_before_reset(self, triplet: SweepTriplet) -> bool:
        """Whether the stream was reset since it formed a triplet."""
        return triplet.stretch is not self._since_reset

    def prepare(self, triplet: SweepTriplet) -> PreparedTriplet:
        """The first half of an estimate: work that each sweep needs once.

        An error is kept until it is the triplet's turn.
        """
        with self._preparation:
            triplet = replace(triplet, stretch=self._stretch_of(triplet))
            self._prepared_by = self._estimator
            return _prepared(triplet, self._estimator)

    def estimate(
        self, prepared: PreparedTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """The second half of an estimate.

        Raises:
            OvertakenError: A newer triplet was prepared with other settings meanwhile.
            CancelledError: If `cancelled` returns True.
            MnsfError: There is no flow for this triplet; the stream goes on.
        """
        adapted = self._adapted(prepared)
        if adapted.error is not None:
            raise adapted.error
        estimator = adapted.estimator
        if isinstance(estimator, PreparingEstimator):
            return estimator.estimate(adapted.triplet, cancelled, adapted.content)
        return estimator.estimate(adapted.triplet, cancelled)

    def _with_settings(
        self, estimator: SceneFlowEstimator, settings: Settings
    ) -> SceneFlowEstimator:
        """Another estimator with the same memory."""
        return estimator.with_settings(settings_for(self.method, settings))

    def _stretch_of(self, triplet: SweepTriplet) -> Stretch:
        """The stretch of a triplet, which begins with it if it does not continue the last one."""
        last, self._last = self._last, triplet
        if last is None or last.stretch is not triplet.stretch:
            self._stretch = Stretch(Start.COLD_FIRST)
        elif last.next not in triplet.sweeps:
            first = triplet.current if triplet.previous is None else triplet.previous
            arrival = Arrival.of(first, last.next, self.traits.max_gap_s)
            if arrival is not Arrival.ACCEPTED:
                self._stretch = Stretch(_STARTS[arrival])
        return self._stretch

    def _adapted(self, prepared: PreparedTriplet) -> PreparedTriplet:
        """The triplet prepared with the settings that hold by now."""
        settings = self.settings
        if settings is self._adapted_to and prepared.estimator is self._estimator:
            return prepared
        with self._preparation:
            if settings is not self._adapted_to:
                self._estimator = self._with_settings(self._estimator, settings)
                self._adapted_to = settings
            # By another estimator than this triplet: a newer one came between with other settings.
            is_overtaken = self._prepared_by is not prepared.estimator
            if is_overtaken and isinstance(self._estimator, PreparingEstimator):
                # Sweeps can be prepared in their order only.
                raise OvertakenError("a newer triplet was prepared with other settings")
            # Under the same lock: the next triplet is prepared after this one.
            return _prepared(prepared.triplet, self._estimator)


def _prepared(triplet: SweepTriplet, estimator: SceneFlowEstimator) -> PreparedTriplet:
    if not isinstance(estimator, PreparingEstimator):
        return PreparedTriplet(triplet, estimator)
    try:
        return PreparedTriplet(triplet, estimator, estimator.prepare(triplet))
    except (Exception, SystemExit) as error:  # noqa: BLE001 - it is told when it is the triplet's turn
        return PreparedTriplet(triplet, estimator, error=error)
