"""Start and end of the node's process."""

from __future__ import annotations

import os
import signal
import sys
from types import FrameType
from typing import TYPE_CHECKING

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.command_line import refuse_options
from mnsf_ros.node.environment import (
    NoRosError,
    prepare_environment,
    require_ros,
    transport_fault,
)
from mnsf_ros.node.process_memory import keep_memory
from mnsf_ros.node.ros_log import log_to_ros

if TYPE_CHECKING:
    from rclpy.executors import SingleThreadedExecutor

    from mnsf_ros.node.scene_flow_node import SceneFlowLifecycleNode, SceneFlowNode

# Together with the rest of the shutdown this stays below the second that users grant a Ctrl-C.
_CLOSE_TIMEOUT_S = 0.5

_EXIT_USAGE = 2

# That of SceneFlowNode, which is not loaded yet when the first things go wrong.
_LOGGER_NAME = "scene_flow"


def main(*, has_life_cycle: bool = False) -> None:
    """Runs the node until SIGINT or SIGTERM; one with a life cycle starts unconfigured.

    Ends the process: 0 after a signal, 2 if something that the user gave cannot be used, said in
    one line.
    """
    signals = _EndSignals()
    refuse_options(sys.argv[1:], has_life_cycle=has_life_cycle)
    prepare_environment()
    keep_memory()
    try:
        require_ros()
    except NoRosError as error:
        sys.stderr.write(f"{error}\n")
        sys.exit(_EXIT_USAGE)
    status = _run(signals, has_life_cycle=has_life_cycle)
    for stream in (sys.stdout, sys.stderr):
        # None where the caller has closed it.
        if stream is not None:
            stream.flush()
    # All is cleaned up. The worker may still be inside a library call of seconds, for example a
    # large distance transform, under which an interpreter that shuts down aborts; and taking down
    # an interpreter with torch in it lasts half a second, which a Ctrl-C should not.
    os._exit(status)


class _EndSignals:
    """SIGINT and SIGTERM: without a KeyboardInterrupt, which could come in the clean-up, too.

    `ros2 launch` delivers Ctrl-C twice. Until ROS runs, there is nothing to clean up, and the
    process ends at once; afterwards rclpy's handler, which goes before this one, ends the spinning.
    """

    def __init__(self) -> None:
        self._is_left_to_rclpy = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def leave_to_rclpy(self) -> None:
        """To be called when rclpy's handlers are there, before there is anything to clean up."""
        self._is_left_to_rclpy = True

    def _on_signal(self, _number: int, _frame: FrameType | None) -> None:
        if not self._is_left_to_rclpy:
            os._exit(0)


def _run(signals: _EndSignals, *, has_life_cycle: bool) -> int:
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.logging import get_logger

    status, node = 0, None
    try:
        _init_ros()
        log_to_ros(get_logger(_LOGGER_NAME))
        fault = transport_fault()
        if fault:
            get_logger(_LOGGER_NAME).warning(fault)
        # It loads all libraries, which takes a while: after mistakes in the ROS arguments.
        from mnsf_ros.node.scene_flow_node import SceneFlowLifecycleNode, SceneFlowNode

        # An executor that a signal keeps from being made complains when it is deleted.
        executor = SingleThreadedExecutor()
        signals.leave_to_rclpy()
        node = SceneFlowLifecycleNode() if has_life_cycle else SceneFlowNode()
        executor.add_node(node)
        _spin(executor, node)
    except (SettingsError, ParameterException) as error:
        get_logger(_LOGGER_NAME).fatal(str(error))
        status = _EXIT_USAGE
    except Exception:
        # A signal takes the context away at any time, and what is under way then fails.
        if rclpy.ok():
            raise
    finally:
        if node is not None:
            node.close(_CLOSE_TIMEOUT_S)
            node.destroy_node()
        rclpy.try_shutdown()
    return status


def _init_ros() -> None:
    """Reads the ROS arguments of the command line and parameter files."""
    import rclpy

    try:
        rclpy.init()
    except Exception as error:  # noqa: BLE001 - rclpy's classes for this are private
        text = " ".join(str(error).split())
        raise SettingsError(f"cannot start ROS: {type(error).__name__}: {text}") from None


def _spin(executor: SingleThreadedExecutor, node: SceneFlowNode | SceneFlowLifecycleNode) -> None:
    """Runs the node's callbacks until a signal comes."""
    import rclpy

    while rclpy.ok():
        try:
            executor.spin()
        except Exception as error:  # noqa: BLE001 - rclpy's parameter services raise what they like
            node.report_error("executor", error)
