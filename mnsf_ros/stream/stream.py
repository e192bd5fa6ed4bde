# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A stream of sweeps to a stream of flows. Live and offline, everything goes through here."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Final

from mnsf_ros.core.compute_device import check_device
from mnsf_ros.core.flow_estimate import Effort, FlowEstimate
from mnsf_ros.core.scene_flow_estimator import (
    MethodTraits,
    PreparingEstimator,
    SceneFlowEstimator,
    never,
)
from mnsf_ros.ego_motion.lidar_rotation import LidarRotation
from mnsf_ros.errors import SettingsError
from mnsf_ros.methods import make_method
from mnsf_ros.online.preparation import PreparedSweeps
from mnsf_ros.presets import settings_for
from mnsf_ros.settings import Settings
from mnsf_ros.stream.sensor_frame import in_sensor_frame
from mnsf_ros.sweeps.mounting_estimate import MountingEstimate
from mnsf_ros.sweeps.sweep import Start, Sweep, SweepTriplet
from mnsf_ros.sweeps.sweep_buffer import Arrival, SweepBuffer

_STARTS: Final = {
    Arrival.GAP: Start.COLD_GAP,
    Arrival.FRAME_CHANGED: Start.COLD_FRAME,
    Arrival.OUT_OF_ORDER: Start.COLD_TIME_JUMP,
    Arrival.TIME_WENT_BACK: Start.COLD_TIME_JUMP,
}


@dataclass(frozen=True, eq=False)
class PreparedTriplet:
    """A triplet between the two halves of its estimate; never changed."""

    triplet: SweepTriplet  # in the frame of the sensor
    levelled: SweepTriplet  # the same as the method gets it
    estimator: SceneFlowEstimator  # the one that prepared it, and estimates
    settings: Settings  # of the stream at that time
    start: Start  # why the estimator began with an earlier triplet, or with this one
    content: Any = None  # the preparation; None if the estimator prepares nothing
    error: BaseException | None = None  # why there is no flow for it

    @property
    def is_prepared(self) -> bool:
        """Whether there was anything to prepare."""
        return self.content is not None or self.error is not None


class Stream:
    """Takes sweeps in the order of time and gives the flow of the one before the newest.

    It owns what continuity means: which sweeps form a triplet (`SweepBuffer`), and whether a method
    may build on the triplets before. An estimator lives for one stretch without a break. A renewed
    one goes on where time goes back, `frame_id` changes, the method gets no triplet for longer than
    its `max_gap_s`, or a setting of the estimates changes.

    It owns the mounting, too: methods get sweeps in a level frame with the lens at its origin, and
    everyone else has them, and the estimates, in the frame of the sensor. Methods also get times of
    points that have none, once the stream shows that the lidar turns.

    `push` does everything in one thread. Its three parts may also have one thread each: `add`,
    `prepare` and `estimate`. `prepare` takes triplets in their order; those that are dropped
    between two parts are simply not handed on. `change_settings` is for the thread that adds.

    Attributes:
        triplet: The triplet that the newest sweep completes, if any.
        settings: They hold from the next preparation on.
        mounting: How the sensor is mounted.
        rotation: Whether a lidar without times of points turns.
    """

    def __init__(
        self, settings: Settings, method: str = "", *, after: "Stream | None" = None
    ) -> None:
        """Starts without any sweep.

        Args:
            settings: They can be changed.
            method: Its name; default: `method.name` of the settings.
            after: A stream of the same method that this one replaces.

        Raises:
            SettingsError: There is no such method, or the settings ask for a device that is not
                there.
            LibraryError: The method needs a library that is not installed.
        """
        self.settings = settings
        self.method: Final = method or settings.method.name
        self.triplet: SweepTriplet | None = None
        self._estimator = (
            make_method(self.method, settings) if after is None else after._renewed(settings)
        )
        self.mounting: MountingEstimate = MountingEstimate() if after is None else after.mounting
        self.mounting.forget()
        self.rotation: LidarRotation = LidarRotation() if after is None else after.rotation
        self.rotation.forget()
        self._buffer = SweepBuffer(num_kept=self._estimator.traits.num_sweeps)
        # What follows belongs to the preparation.
        self._last: SweepTriplet | None = None
        self._prepared_with = settings
        self._start = Start.COLD_FIRST
        self._break: Start | None = None

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
        return None if self.triplet is None else self.flow_of(self.triplet, cancelled)

    def flow_of(self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never) -> FlowEstimate:
        """Both halves of the estimate of a triplet, one after the other.

        Raises:
            MnsfError: There is no flow for this triplet; the stream goes on.
        """
        return self.estimate(self.prepare(triplet), cancelled)

    def add(self, sweep: Sweep) -> Arrival:
        """Adds the newest sweep to the buffer, see `triplet`. Returns how it follows the last."""
        sweep = self.mounting.mounted(sweep, self.settings)
        arrival, self.triplet = self._buffer.push(sweep, self.settings.buffer)
        return arrival

    def change_settings(self, settings: Settings) -> None:
        """Lets other settings hold from the next preparation on. The method stays.

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

    def prepare(self, triplet: SweepTriplet) -> PreparedTriplet:
        """The first half of an estimate: work that each sweep needs once.

        An error is kept until it is the triplet's turn.
        """
        settings, content, failure = self.settings, None, None
        self._break = self._break_before(triplet, settings) or self._break
        self._last, self._prepared_with = triplet, settings
        if self._break is not None:
            self.rotation.begin(self._break)
        # Predictions of other programs are in the frame of the sensor.
        levelled = triplet if self.traits.is_external else triplet.levelled
        levelled = self.rotation.timed(levelled, settings)
        try:
            if self._break is not None:
                self._estimator = self._renewed(settings)
                self._start, self._break = self._break, None
            if isinstance(self._estimator, PreparingEstimator):
                content = self._estimator.prepare(levelled)
            if isinstance(content, PreparedSweeps):
                last, newest = ((each.input, each.pose) for each in content.of_triplet[-2:])
                if self.rotation.learn(last, newest, settings):
                    self._break = Start.COLD_TIMES
        except (Exception, SystemExit) as error:  # noqa: BLE001 - it is told when it is the triplet's turn
            failure = error
        return PreparedTriplet(
            triplet, levelled, self._estimator, settings, self._start, content, failure
        )

    def estimate(
        self,
        prepared: PreparedTriplet,
        cancelled: Callable[[], bool] = never,
        effort: Effort = Effort.FULL,
    ) -> FlowEstimate:
        """The second half of an estimate, with less effort if the method can do that.

        Raises:
            CancelledError: If `cancelled` returns True.
            MnsfError: There is no flow for this triplet; the stream goes on.
        """
        if prepared.error is not None:
            raise prepared.error
        estimator = prepared.estimator
        if isinstance(estimator, PreparingEstimator):
            estimate = estimator.estimate(prepared.levelled, cancelled, prepared.content, effort)
        else:
            estimate = estimator.estimate(prepared.levelled, cancelled)
        if prepared.levelled is not prepared.triplet:
            estimate = in_sensor_frame(estimate, prepared.triplet.current)
        if estimate.start is Start.COLD_FIRST:
            estimate = replace(estimate, start=prepared.start)
        return estimate

    def _renewed(self, settings: Settings) -> SceneFlowEstimator:
        """An estimator that has seen nothing."""
        return self._estimator.renewed(settings_for(self.method, settings))

    def _break_before(self, triplet: SweepTriplet, settings: Settings) -> Start | None:
        """Why a triplet does not continue the one prepared before it; None if it does."""
        last, before = self._last, self._prepared_with
        if last is not None and last.next not in triplet.sweeps:
            first = triplet.current if triplet.previous is None else triplet.previous
            arrival = Arrival.of(first, last.next, self.traits.max_gap_s)
            if arrival is not Arrival.ACCEPTED:
                return _STARTS[arrival]
        are_same = settings is before or (
            settings_for(self.method, settings).of_estimates
            == settings_for(self.method, before).of_estimates
        )
        if are_same:
            return None
        return Start.COLD_FIRST if last is None else Start.COLD_SETTINGS
