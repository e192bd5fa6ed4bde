# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The two kinds of node around the same parts: a plain one, and one with a life cycle."""

from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.logging import LoggingSeverity, set_logger_level
from rclpy.node import Node
from std_srvs.srv import SetBool

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.node_log import FaultLog
from mnsf_ros.node.parameters import NodeParameters
from mnsf_ros.node.scene_flow_parts import SceneFlowParts
from mnsf_ros.stream.pipeline import CALLBACK_ERRORS

NODE_NAME = "scene_flow"

_DISABLED = "disabled, see the service set_enabled"
_INACTIVE = "inactive, see ros2 lifecycle"
# A transition waits so long for the estimate under way to end.
_CLEANUP_TIMEOUT_S = 1.0
_ENTITIES = ("timer", "subscription", "service", "client", "publisher")


class _FlowNode(Node):
    """A node with parameters and, from `start` or its configuration to `close`, other parts."""

    _parts: SceneFlowParts | None = None

    def __init__(self) -> None:
        super().__init__(NODE_NAME)
        self._faults = FaultLog(self.get_logger().name)

    def close(self, timeout_s: float) -> None:
        """Abandons the estimate under way, and waits for that as long as the timeout."""
        if self._parts is not None:
            self._parts.close(timeout_s)

    def report_error(self, error: Exception) -> None:
        """Logs an unexpected error, unless ROS is shutting down; counts it while configured."""
        if not self.context.ok():
            return
        if self._parts is not None:
            self._parts.statistics.count(CALLBACK_ERRORS)
        self._faults.unexpected("callback", error)


class SceneFlowNode(_FlowNode):
    """Works from its start to its end."""

    def start(self) -> None:
        """Declares the parameters and subscribes.

        Raises:
            SettingsError: If a parameter was given an invalid value.
        """
        self._parts = SceneFlowParts(self, NodeParameters(self), self._faults)
        self.create_service(SetBool, "~/set_enabled", partial(_set_enabled, self._parts))


def _set_enabled(
    parts: SceneFlowParts, request: SetBool.Request, response: SetBool.Response
) -> SetBool.Response:
    parts.pause("" if request.data else _DISABLED)
    response.success, response.message = True, "enabled" if request.data else "disabled"
    return response


class SceneFlowLifecycleNode(_FlowNode, LifecycleNode):
    """Works while it is active.

    Unconfigured it has its parameters only. Configured it subscribes and publishes
    `/diagnostics`, but ignores clouds until it is activated.
    """

    def start(self) -> None:
        """Declares the parameters.

        Raises:
            SettingsError: If a parameter was given an invalid value.
        """
        # It repeats the labels of unknown transitions, however long they are.
        set_logger_level("rcl_lifecycle", LoggingSeverity.ERROR)
        self._own_parameters = NodeParameters(self, has_life_cycle=True)
        self._own_entities = _entities(self)
        for service in self.services:
            if service.srv_type is ChangeState:
                service.callback = partial(self._answer_change, service.callback)

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Makes the parts; fails if the settings ask for something unavailable."""
        return self._result_of("configure", self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Takes clouds from now on."""
        return self._result_of("activate", partial(self._pause, ""))

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ignores clouds from now on, and forgets the sweeps before."""
        return self._result_of("deactivate", partial(self._pause, _INACTIVE))

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Destroys everything but the parameters; so do a shutdown and an error."""
        return self._result_of("clean up", self._clean_up)

    on_shutdown = on_cleanup
    on_error = on_cleanup

    def _configure(self) -> None:
        try:
            self._parts = SceneFlowParts(self, self._own_parameters, self._faults, _INACTIVE)
        except BaseException:
            self._clean_up()
            raise

    def _pause(self, reason: str) -> None:
        if self._parts is not None:
            self._parts.pause(reason)

    def _clean_up(self) -> None:
        parts, self._parts = self._parts, None
        if parts is not None:
            parts.close(_CLEANUP_TIMEOUT_S)
        for entity, kind in _entities(self).items():
            if entity not in self._own_entities:
                getattr(self, f"destroy_{kind}")(entity)

    def _answer_change(
        self,
        change: Callable[[ChangeState.Request, ChangeState.Response], ChangeState.Response],
        request: ChangeState.Request,
        response: ChangeState.Response,
    ) -> ChangeState.Response:
        """Refuses what rclpy raises at without an answer: a number that the state does not have."""
        try:
            return change(request, response)
        except Exception as error:  # noqa: BLE001 - its class is private
            self.report_error(error)
            response.success = False
            return response

    def _result_of(self, transition: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        """Result of a transition; an error is logged, which rclpy does not."""
        try:
            action()
        except SettingsError as error:
            self.get_logger().error(f"cannot {transition}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001 - the life cycle has a state for it
            self.report_error(error)
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS


def _entities(node: Node) -> dict[Any, str]:
    """Topics, services and timers of a node, each with its kind."""
    return {entity: kind for kind in _ENTITIES for entity in getattr(node, f"{kind}s")}
