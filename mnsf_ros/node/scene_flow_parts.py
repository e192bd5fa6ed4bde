# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The parts of either kind of node: sweeps in, flow out."""

from dataclasses import replace

from diagnostic_msgs.msg import DiagnosticArray
from rclpy.clock import Clock, ClockType
from rclpy.node import Node
from std_srvs.srv import Trigger

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.errors import MnsfError, SettingsError
from mnsf_ros.input_check.input_check import InputCheck
from mnsf_ros.input_check.sweep_sample import Located
from mnsf_ros.node.diagnostics import REASONS, Diagnostics
from mnsf_ros.node.environment import RETURN_PERIOD_S, return_memory
from mnsf_ros.node.explanations import Explanations
from mnsf_ros.node.flow_outputs import DebugTimes, FlowOutputs
from mnsf_ros.node.node_log import FaultLog, greeting
from mnsf_ros.node.parameters import NodeParameters, UnknownParameterError, undeclared_overrides
from mnsf_ros.node.sweep_input import TRANSFORMS_MISSING, SweepInput
from mnsf_ros.node.transforms import OdometryFrame, TransformError
from mnsf_ros.settings import Settings
from mnsf_ros.stream.pipeline import StreamPipeline, StreamStatistics, TripletJob
from mnsf_ros.sweeps.sweep import NANOSECONDS, Sweep
from mnsf_ros.sweeps.sweep_buffer import Arrival

_REFRESH_PERIOD_S = 0.2
_MIN_CHECKED = 20  # sweeps; the first ones of a bag or a driver are odd
_PAUSE_PERIOD_S = 1.0  # between two lines of one kind in the log


class SceneFlowParts:
    """Subscribes to `~/points` and, if asked to, `~/odometry`; publishes flow and `/diagnostics`.

    Callbacks of the executor only decode and hand over; the pipeline's threads estimate and
    publish. Call `close` before destroying the node.
    """

    def __init__(
        self, node: Node, parameters: NodeParameters, faults: FaultLog, pause: str = ""
    ) -> None:
        """Subscribes and advertises on behalf of a node; `pause` is a reason to start paused.

        Raises:
            SettingsError: If the settings ask for something unavailable.
        """
        self._node = node
        self._parameters = parameters
        self._logger = node.get_logger()
        self._faults = faults
        self._mounting = ""  # as logged last
        self._told = ("", False)
        try:
            self._join_topics(pause)
        except RuntimeError as error:
            if not node.context.ok():
                raise
            raise SettingsError(f"a topic cannot be used, see qos_overrides: {error}") from None
        self._input_check = self._new_input_check(parameters.settings)
        name = node.get_fully_qualified_name().lstrip("/")
        self._diagnostics = Diagnostics(name, faults, lambda: self._input.silence)
        self._diagnostics_publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        node.create_service(Trigger, "~/reset", self._on_reset)
        self._start_timers()
        parameters.follow(self._change_settings)
        self._greet()

    def pause(self, reason: str) -> None:
        """Ignores clouds from now on, and forgets all sweeps; takes them again without a reason."""
        if reason != self._input.pause:
            text = reason or "clouds are taken"
            self._logger.info(text, throttle_duration_sec=_PAUSE_PERIOD_S)
        self._input.pause = reason
        if reason:
            self.reset()

    def reset(self) -> None:
        """Forgets all sweeps and tracks; an estimate under way is abandoned."""
        self._pipeline.reset()
        self._input.reset()
        self._input_check = self._new_input_check(self._settings)

    def close(self, timeout_s: float) -> None:
        """Abandons the estimate under way, and waits for that as long as the timeout."""
        self._parameters.follow(None)
        self._pipeline.close(timeout_s)

    @property
    def statistics(self) -> StreamStatistics:
        """Counters and recent figures."""
        return self._pipeline.statistics

    @property
    def _settings(self) -> Settings:
        return self._parameters.settings

    def _new_input_check(self, settings: Settings) -> InputCheck:
        mounting, rotation = self._pipeline.mounting, self._pipeline.rotation
        return InputCheck(settings, mounting, rotation, is_live=True)

    def _join_topics(self, pause: str) -> None:
        """Makes the way of a sweep from its end to its start, so that each part has its next."""
        settings = self._settings
        self._outputs = FlowOutputs(self._node, settings.node.odom_frame)
        self._debug_times = DebugTimes(self._node)
        self._explanations = Explanations(self._node)
        self._frame = (
            OdometryFrame(self._node, settings.node.odom_frame, settings.tf.base_frame)
            if settings.tf.broadcast
            else None
        )
        self._pipeline = StreamPipeline(settings, self._publish, self._on_failure)
        try:
            on_break = self._pipeline.reset
            self._input = SweepInput(
                self._node, settings, self._report, self._on_sweep, pause, on_break
            )
        except BaseException:
            self._pipeline.close(0.0)
            raise

    def _start_timers(self) -> None:
        # Steady: under use_sim_time a node timer stands still until somebody publishes /clock.
        clock = Clock(clock_type=ClockType.STEADY_TIME)
        for period_s, callback in (
            (_REFRESH_PERIOD_S, self._refresh),
            (self._settings.node.diagnostics_period_s, self._publish_diagnostics),
            (RETURN_PERIOD_S, return_memory),
        ):
            self._node.create_timer(period_s, callback, clock=clock)

    def _greet(self) -> None:
        for name in undeclared_overrides(self._node):
            self._logger.warning(f"ignored: {UnknownParameterError(name)}")
        if unused := self._settings.without_effect:
            self._logger.warning(unused)
        self._logger.info(greeting(self._settings))
        sweeps = f"sweeps from {self._input.state.topic}"
        if self._input.is_searching:
            sweeps = "waits for the only topic of clouds"
        self._logger.info(f"{sweeps}, flow on {self._outputs.topic}")

    def _report(self, event: str, text: str, how_many: int = 1) -> None:
        self._pipeline.statistics.count(event, how_many)
        self._faults.warn(event, text)

    def _on_sweep(self, sweep: Sweep, arrived_ns: int) -> None:
        is_wanted = self._settings.node.always_estimate or self._frame is not None
        is_wanted = is_wanted or self._outputs.are_watched or self._explanations.are_watched
        arrival = self._pipeline.add_sweep(sweep, arrived_ns, is_watched=is_wanted)
        self._tell_mounting(sweep.frame_id)
        if arrival is not Arrival.ACCEPTED:
            # A recording that is played in a loop has gaps, too.
            tell = self._faults.inform if arrival is Arrival.GAP else self._faults.warn
            cause, stamp_s = REASONS[f"sweeps_{arrival.value}"], sweep.stamp_ns / NANOSECONDS
            tell(arrival.value, f"{cause}, at the stamp {stamp_s:.3f}")
        self._input_check.add(sweep, self._input.num_parts)

    def _tell_mounting(self, frame_id: str) -> None:
        mounting = self._pipeline.mounting
        if mounting.text != self._mounting:
            self._mounting = mounting.text
            self._logger.info(f"mounting of {frame_id!r}: {mounting.text}")

    def _on_reset(self, _request: object, response: Trigger.Response) -> Trigger.Response:
        self.reset()
        response.success, response.message = True, "all sweeps and tracks are forgotten"
        return response

    def _publish(self, job: TripletJob, estimate: FlowEstimate) -> None:
        """Runs in the thread of the output."""
        self._outputs.publish(job.triplet, estimate, self._settings)
        self._debug_times.publish(estimate.time_ms, job.arrived_ns)
        self._explanations.keep(job.triplet, estimate)
        self._input_check.locate(Located.by(estimate, job.triplet.current))
        if self._frame is not None and estimate.over_ground is not None:
            header = job.triplet.current.source.message.header
            try:
                self._frame.publish(header, estimate.over_ground, self._input.transforms)
            except TransformError as error:
                self._report(TRANSFORMS_MISSING, f"{error}; the robot's pose is not broadcast")

    def _on_failure(self, job: TripletJob, error: Exception) -> None:
        """Runs in a thread of the pipeline."""
        if not self._node.context.ok():
            return
        text = f"no flow for the {job.triplet.current}"
        if isinstance(error, MnsfError):
            self._faults.warn(f"refused {type(error).__name__}", f"{text}: {error}")
            return
        self._faults.unexpected(text, error)

    def _refresh(self) -> None:
        self._input.refresh()
        # Whoever relies on the flow must not wait for the next diagnostics.
        if self._urgent != self._told:
            self._publish_diagnostics()

    @property
    def _urgent(self) -> tuple[str, bool]:
        """Why the ego motion is lost, and whether something in the input stopped to hold."""
        return self._pipeline.statistics.snapshot().lost, self._input_check.is_alarm

    def _publish_diagnostics(self) -> None:
        message, snapshot = DiagnosticArray(), self._pipeline.statistics.snapshot()
        self._told, self._input_check.is_played = self._urgent, self._input.is_played
        message.header.stamp = self._node.get_clock().now().to_msg()
        message.status = self._diagnostics.statuses(
            snapshot,
            replace(self._input.state, mounting=self._pipeline.mounting.text),
            self._pipeline.load,
            self._settings,
            self._input_check.findings() if self._input_check.num_clouds > _MIN_CHECKED else None,
        )
        self._diagnostics_publisher.publish(message)

    def _change_settings(self, settings: Settings) -> None:
        # Both may refuse.
        self._pipeline.change_settings(settings)
        try:
            self._input.change_settings(settings)
        except SettingsError:
            self._pipeline.change_settings(self._settings)
            raise
        self._input_check = self._new_input_check(settings)
