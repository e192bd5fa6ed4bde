"""`scene_flow_node` and `python -m mnsf_ros.node` run the scene flow node.

Nothing is imported before signals are handled: Python would answer one with a traceback.
"""

import os
import signal
import sys


def main() -> None:
    """Runs the node and ends the process, see `mnsf_ros.node.main.main`."""
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda _number, _frame: os._exit(0))
    try:
        from mnsf_ros.node import main as node

        node.main()
    except ModuleNotFoundError as error:
        from mnsf_ros.errors import library_missing

        sys.stderr.write(f"scene_flow_node: {library_missing(error)}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
