"""`scene_flow_node`, `scene_flow_lifecycle_node` and `python -m mnsf_ros.node` run the node.

Nothing is imported before signals are handled: Python would answer one with a traceback.
"""

import os
import signal
import sys


def main(*, has_life_cycle: bool = False) -> None:
    """Runs the node and ends the process, see `mnsf_ros.node.main.main`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: os._exit(0))
    try:
        from mnsf_ros.node import main as node

        node.main(has_life_cycle=has_life_cycle)
    except ModuleNotFoundError as error:
        from mnsf_ros.errors import library_missing

        sys.stderr.write(f"scene_flow_node: {library_missing(error)}\n")
        sys.exit(2)


def lifecycle_main() -> None:
    """Runs the node with a life cycle, see `main`."""
    main(has_life_cycle=True)


if __name__ == "__main__":
    main()
