# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf` and `python -m mnsf_ros.cli` run a subcommand.

Signals are handled before all else is imported: Python would answer one with a traceback.
"""

import os
import signal
import sys


def _leave(*_signal: object) -> None:
    os.write(2, b"mnsf: interrupted\n")
    os._exit(130)


def main() -> None:
    """Runs a subcommand and ends the process, see `mnsf_ros.cli.main.main`."""
    if signal.getsignal(signal.SIGINT) is not signal.SIG_IGN:
        signal.signal(signal.SIGINT, _leave)
    try:
        from mnsf_ros.cli import main as command

        command.main()
    except ModuleNotFoundError as error:
        from mnsf_ros.errors import library_missing

        sys.stderr.write(f"mnsf: {library_missing(error)}\n")
        sys.exit(2)


if __name__ == "__main__":
    main()
