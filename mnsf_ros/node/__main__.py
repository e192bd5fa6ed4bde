# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`scene_flow_node`, `scene_flow_lifecycle_node` and `python -m mnsf_ros.node` run the node.

No library is imported before signals are handled: Python would answer one with a traceback.
"""

import os
import sys

try:
    import argparse
    import signal
    from itertools import takewhile
    from typing import TYPE_CHECKING, NoReturn

    from mnsf_ros import __version__
    from mnsf_ros.errors import SettingsError, library_missing, one_line
except KeyboardInterrupt:
    os._exit(0)

if TYPE_CHECKING:
    from rclpy.executors import SingleThreadedExecutor

    from mnsf_ros.node.scene_flow_node import SceneFlowLifecycleNode, SceneFlowNode

# Together with the rest of the shutdown this stays below the second that users grant a Ctrl-C.
_CLOSE_TIMEOUT_S = 0.5
# On a signal, rclpy wakes the executor before it shuts the context down: one that waits again by
# then, and has no timer, would wait for ever.
_SPIN_S = 0.2

_EXIT_USAGE = 2
# That of SceneFlowNode, which is not loaded yet when the first things go wrong.
_LOGGER_NAME = "scene_flow"

_DESCRIPTION = """\
Estimates the scene flow of a lidar: how every point of each sweep moves.

  in   ~/points (sensor_msgs/PointCloud2), ~/imu (sensor_msgs/Imu, where there is one),
       ~/odometry (nav_msgs/Odometry, if asked for)
  out  ~/flow, ~/flow/moving, ~/flow/standing, ~/objects, ~/predicted, ~/ego_motion,
       /diagnostics"""
_LIFE_CYCLE = """

It starts unconfigured: ros2 lifecycle set /scene_flow configure, then activate."""
_EPILOG = """\
ROS arguments:
  -r '~/points:=/lidar/points'    topic of the lidar; without it, the only one with clouds
  -r __ns:=/front                 namespace
  -r __node:=flow                 name, scene_flow by default
  -p crop.max_range_m:=60         a parameter; all of them: mnsf parameters
  --params-file my.yaml           several parameters
  --log-level debug

example:
  scene_flow_node --ros-args -r '~/points:=/lidar/points' -p ego_motion.source:=odometry"""


def main(*, has_life_cycle: bool = False) -> None:
    """Runs the node until SIGINT or SIGTERM; one with a life cycle starts unconfigured.

    Ends the process: 0 after a signal, 2 for invalid input of the user, which is said in one line,
    1 if the middleware hangs at the end.
    """
    signals = _EndSignals()
    _refuse_options(sys.argv[1:], has_life_cycle=has_life_cycle)
    try:
        from mnsf_ros.node.environment import keep_memory, prepare_environment

        prepare_environment(is_node=True)
        keep_memory()
        status = _run(signals, has_life_cycle=has_life_cycle)
    except ModuleNotFoundError as error:
        _refuse(library_missing(error))
    except SettingsError as error:
        _refuse(str(error))
    for stream in (sys.stdout, sys.stderr):
        # None where the caller has closed it.
        if stream is not None:
            stream.flush()
    # All is cleaned up. The worker may still be inside a library call of seconds, for example a
    # large distance transform, under which an interpreter that shuts down aborts; and taking down
    # an interpreter with torch in it lasts half a second, which a Ctrl-C should not.
    os._exit(status)


def lifecycle_main() -> None:
    """Runs the node with a life cycle, see `main`."""
    main(has_life_cycle=True)


def _refuse(text: str) -> NoReturn:
    sys.stderr.write(f"scene_flow_node: {text}\n")
    sys.exit(_EXIT_USAGE)


class _EndSignals:
    """SIGINT and SIGTERM: without a KeyboardInterrupt, which could come in the clean-up, too.

    `ros2 launch` delivers Ctrl-C twice. Until ROS runs, there is nothing to clean up, and the
    process ends at once. Then rclpy's handlers, which go before those of Python, end the spinning.
    """

    def __init__(self) -> None:
        self.are_left_to_rclpy = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def _on_signal(self, _number: int, _frame: object) -> None:
        if not self.are_left_to_rclpy:
            os._exit(0)


def _refuse_options(arguments: list[str], *, has_life_cycle: bool) -> None:
    """Answers --help and --version; other options before `--ros-args` end it with status 2."""
    parser = argparse.ArgumentParser(
        prog="scene_flow_lifecycle_node" if has_life_cycle else "scene_flow_node",
        description=_DESCRIPTION + (_LIFE_CYCLE if has_life_cycle else ""),
        epilog=_EPILOG,
        usage="%(prog)s [-h] [--version] [--ros-args ...]",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"mnsf_ros {__version__}")
    before = takewhile(lambda word: word != "--ros-args", arguments)
    if others := parser.parse_known_args([*before])[1]:
        advice = "put --ros-args before remaps and parameters: -r '~/points:=/lidar/points'"
        parser.error(f"unrecognized arguments: {' '.join(others)}; {advice}")


def _run(signals: _EndSignals, *, has_life_cycle: bool) -> int:
    import rclpy
    from rclpy.exceptions import ParameterException
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.logging import get_logger

    from mnsf_ros.node.environment import leaving_ros

    status, node, logger = 0, None, get_logger(_LOGGER_NAME)
    try:
        try:
            rclpy.init()
        except Exception as error:  # noqa: BLE001 - rclpy's classes for this are private
            has_none = any(word.endswith(":=") for word in sys.argv)
            hint = "; expected a value after :=, an empty text is \"NAME:=''\"" if has_none else ""
            raise SettingsError(f"cannot start ROS: {one_line(error)}{hint}") from None
        # It loads all libraries, which takes a while: after mistakes in the ROS arguments.
        from mnsf_ros.node.node_log import log_to_ros
        from mnsf_ros.node.scene_flow_node import SceneFlowLifecycleNode, SceneFlowNode

        log_to_ros(logger)
        # An executor that a signal keeps from being made complains when it is deleted.
        executor = SingleThreadedExecutor()
        signals.are_left_to_rclpy = True
        node = SceneFlowLifecycleNode() if has_life_cycle else SceneFlowNode()
        node.start()
        executor.add_node(node)
        spin(executor, node)
    except (SettingsError, ParameterException) as error:
        logger.fatal(str(error))
        status = _EXIT_USAGE
    except Exception:
        # A signal takes the context away at any time, and what is under way then fails.
        if rclpy.ok():
            raise
    finally:
        with leaving_ros():
            if node is not None:
                node.close(_CLOSE_TIMEOUT_S)
                node.destroy_node()
            rclpy.try_shutdown()
    return status


def spin(
    executor: "SingleThreadedExecutor", node: "SceneFlowNode | SceneFlowLifecycleNode"
) -> None:
    """Runs the node's callbacks until a signal comes; their errors are logged and counted."""
    while executor.context.ok():
        try:
            executor.spin_once(timeout_sec=_SPIN_S)
        except Exception as error:  # noqa: BLE001 - one failed callback must not end the node
            if executor.context.ok():
                node.report_error(error)


if __name__ == "__main__":
    main()
