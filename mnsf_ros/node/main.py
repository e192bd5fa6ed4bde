"""Start and end of the node's process."""

from __future__ import annotations

import os
import signal
import sys

from mnsf_ros.errors import SettingsError
from mnsf_ros.node.process_environment import prepare_environment

# Together with the rest of the shutdown this stays below the second that users grant a Ctrl-C.
_CLOSE_TIMEOUT_S = 0.5

NO_ROS = (
    "there is no rclpy: source your ROS 2 (source /opt/ros/jazzy/setup.bash), or install its "
    "wheels (pip install 'mnsf_ros[wheels]')"
)


def main() -> None:
    """Runs the node until SIGINT or SIGTERM. Ends the process: 0, or 2 for a wrong parameter."""
    prepare_environment()
    status, has_ended = _run()
    sys.stdout.flush()
    sys.stderr.flush()
    if not has_ended:
        # The worker is inside a library call of seconds, for example a large distance transform,
        # and an interpreter that shuts down under a running thread aborts.
        os._exit(status)
    sys.exit(status)


def _run() -> tuple[int, bool]:
    try:
        import rclpy
    except ModuleNotFoundError as error:
        if error.name != "rclpy":
            raise
        sys.stderr.write(f"{NO_ROS}\n")
        return 2, True
    from rclpy.executors import ExternalShutdownException, SingleThreadedExecutor
    from rclpy.logging import get_logger

    from mnsf_ros.node.scene_flow_node import NODE_NAME, SceneFlowNode

    status, has_ended, node = 0, True, None
    try:
        rclpy.init()
        node = SceneFlowNode()
        executor = SingleThreadedExecutor()
        executor.add_node(node)
        executor.spin()
    except (KeyboardInterrupt, ExternalShutdownException):
        pass
    except SettingsError as error:
        get_logger(NODE_NAME).fatal(str(error))
        status = 2
    finally:
        # `ros2 launch` delivers Ctrl-C twice; the second must not interrupt the clean-up.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, signal.SIG_IGN)
        if node is not None:
            has_ended = node.close(_CLOSE_TIMEOUT_S)
            node.destroy_node()
        rclpy.try_shutdown()
    return status, has_ended


if __name__ == "__main__":
    main()
