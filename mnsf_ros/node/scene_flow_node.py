# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The two kinds of node around the same parts: a plain one, and one with a life cycle."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

from lifecycle_msgs.msg import Transition
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.node import Node
from std_srvs.srv import SetBool

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.parameters import NodeParameters
from mnsf_ros.node.process_end import leaving_ros
from mnsf_ros.node.scene_flow_parts import SceneFlowParts

NODE_NAME = "scene_flow"

_DISABLED = "disabled, see the service set_enabled"
_TRANSITIONS = {
    Transition.TRANSITION_CONFIGURE: "configure",
    Transition.TRANSITION_CLEANUP: "clean up",
    Transition.TRANSITION_ACTIVATE: "activate",
    Transition.TRANSITION_DEACTIVATE: "deactivate",
}
_INACTIVE = "inactive, see ros2 lifecycle"
# A transition waits so long for the estimate under way to end.
_CLEANUP_TIMEOUT_S = 1.0


class SceneFlowNode(Node):
    """Works from its start to its end. Call `close` before destroying it."""

    def __init__(self) -> None:
        """Declares the parameters and starts to listen.

        Raises:
            SettingsError: If a parameter was given a value that it cannot have.
        """
        super().__init__(NODE_NAME)
        with _destroyed_after_error(self):
            self._parts = SceneFlowParts(self, NodeParameters(self))
            self.create_service(SetBool, "~/set_enabled", self._on_set_enabled)

    def close(self, timeout_s: float) -> bool:
        """Abandons the estimate under way; False if it could not be interrupted in time."""
        return self._parts.close(timeout_s)

    def report_error(self, where: str, error: Exception) -> None:
        """Logs and counts an unexpected error, unless ROS is shutting down."""
        self._parts.report_error(where, error)

    def _on_set_enabled(
        self, request: SetBool.Request, response: SetBool.Response
    ) -> SetBool.Response:
        if request.data:
            self._parts.resume()
        else:
            self._parts.pause(_DISABLED)
        response.success, response.message = True, "enabled" if request.data else "disabled"
        self.get_logger().info(response.message)
        return response


class SceneFlowLifecycleNode(LifecycleNode):
    """Works while it is active. Call `close` before destroying it.

    Unconfigured it has its parameters only. Configured it listens and tells its state on
    `/diagnostics`, but ignores clouds until it is activated.
    """

    def __init__(self) -> None:
        """Declares the parameters.

        Raises:
            SettingsError: If a parameter was given a value that it cannot have.
        """
        super().__init__(NODE_NAME)
        with _destroyed_after_error(self):
            self._own_parameters = NodeParameters(self, has_life_cycle=True)
        self._added = _AddedEntities(self)
        self._parts: SceneFlowParts | None = None
        self._refuse_invalid_transitions()

    def close(self, timeout_s: float) -> bool:
        """Abandons the estimate under way; False if it could not be interrupted in time."""
        return self._parts is None or self._parts.close(timeout_s)

    def report_error(self, where: str, error: Exception) -> None:
        """Logs an unexpected error, and counts it while there is something to count with."""
        if self._parts is not None:
            self._parts.report_error(where, error)
        elif self.context.ok():
            self.get_logger().error(f"{where}: {''.join(traceback.format_exception(error))}")

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Makes the parts; fails if the settings ask for what is not there."""
        return self._made("configure", self._configure)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Takes clouds from now on."""
        return self._made("activate", self._activate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Ignores clouds from now on, and forgets the sweeps before."""
        return self._made("deactivate", self._deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lets go of all but the parameters."""
        return self._made("clean up", self._clean_up)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lets go of all but the parameters."""
        return self._made("shut down", self._clean_up)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Lets go of all but the parameters: the node can be configured again."""
        return self._made("clean up after an error", self._clean_up)

    def _configure(self) -> None:
        try:
            self._parts = SceneFlowParts(self, self._own_parameters, _INACTIVE)
        except BaseException:
            self._added.destroy()
            raise

    def _activate(self) -> None:
        if self._parts is not None:
            self._parts.resume()

    def _deactivate(self) -> None:
        if self._parts is not None:
            self._parts.pause(_INACTIVE)

    def _clean_up(self) -> None:
        parts, self._parts = self._parts, None
        if parts is not None:
            parts.close(_CLEANUP_TIMEOUT_S)
        self._added.destroy()

    def _made(self, what: str, action: Callable[[], None]) -> TransitionCallbackReturn:
        """Does what a transition asks for; an error is logged, which rclpy does not."""
        try:
            action()
        except SettingsError as error:
            self.get_logger().error(f"cannot {what}: {error}")
            return TransitionCallbackReturn.FAILURE
        except Exception as error:  # noqa: BLE001 - the life cycle has a state for it
            self.report_error(what, error)
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS

    def _refuse_invalid_transitions(self) -> None:
        """Answers a transition that the state does not have, which rclpy of Jazzy leaves open."""
        service = self._service_change_state
        change = service.callback

        def answer(request: Any, response: Any) -> Any:  # noqa: ANN401 - lifecycle_msgs
            try:
                return change(request, response)
            except Exception:  # noqa: BLE001 - rclpy's class for this is private
                wanted = request.transition
                what = _TRANSITIONS.get(wanted.id, wanted.label or f"make transition {wanted.id}")
                _, state = self._state_machine.current_state
                self.get_logger().warning(f"cannot {what}: the state of the node is {state}")
                response.success = False
                return response

        service.callback = answer


@contextmanager
def _destroyed_after_error(node: Node) -> Iterator[None]:
    """A node that is not finished leaves no shared memory behind."""
    try:
        yield
    except BaseException:
        with leaving_ros():
            node.destroy_node()
        raise


class _AddedEntities:
    """Remembers the topics, services and timers of a node, to destroy those added later.

    So nothing is forgotten, also where only a part could be added before an error.
    """

    def __init__(self, node: Node) -> None:
        self._node = node
        self._before = {id(entity) for entity, _ in self._all()}

    def destroy(self) -> None:
        """Destroys all that was added."""
        for entity, destroy in list(self._all()):
            if id(entity) not in self._before:
                destroy(entity)

    def _all(self) -> Iterator[tuple[Any, Callable[[Any], object]]]:
        """All entities of the node, and what destroys them."""
        node = self._node
        for entities, destroy in (
            (node.timers, node.destroy_timer),
            (node.subscriptions, node.destroy_subscription),
            (node.services, node.destroy_service),
            (node.clients, node.destroy_client),
            (node.publishers, node.destroy_publisher),
        ):
            for entity in entities:
                yield entity, destroy
