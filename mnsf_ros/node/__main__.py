# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`scene_flow_node`, `scene_flow_lifecycle_node` and `python -m mnsf_ros.node` run the node.

Nothing is imported before signals are handled: Python would answer one with a traceback.
"""

import os
import sys

try:
    import signal
except KeyboardInterrupt:
    os._exit(0)


def main(*, has_life_cycle: bool = False) -> None:
    """Runs the node and ends the process, see `mnsf_ros.node.main.main`."""
    signals = _EndSignals()
    try:
        from mnsf_ros.node import main as node

        node.main(signals.leave_to_rclpy, has_life_cycle=has_life_cycle)
    except ModuleNotFoundError as error:
        from mnsf_ros.errors import library_missing

        sys.stderr.write(f"scene_flow_node: {library_missing(error)}\n")
        sys.exit(2)


def lifecycle_main() -> None:
    """Runs the node with a life cycle, see `main`."""
    main(has_life_cycle=True)


class _EndSignals:
    """SIGINT and SIGTERM: without a KeyboardInterrupt, which could come in the clean-up, too.

    `ros2 launch` delivers Ctrl-C twice. Until ROS runs, there is nothing to clean up, and the
    process ends at once.
    """

    def __init__(self) -> None:
        self._are_left = False
        for number in (signal.SIGINT, signal.SIGTERM):
            signal.signal(number, self._on_signal)

    def leave_to_rclpy(self) -> None:
        """Ignores signals from now on."""
        self._are_left = True

    def _on_signal(self, _number: int, _frame: object) -> None:
        if not self._are_left:
            os._exit(0)


if __name__ == "__main__":
    main()
