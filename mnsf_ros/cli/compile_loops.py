# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Compiles all loops for this computer, on all cores: `python -m mnsf_ros.cli.compile_loops`.

The installation does so, so that the first start of a program takes no longer than later ones.
"""

import multiprocessing
import os
import signal
import sys
from collections import defaultdict
from collections.abc import Callable

from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.compiled import postponed

# Of each file, as a function may call others of its file.
_rest: defaultdict[str, list[Callable[[], bool]]] = defaultdict(list)


def main() -> None:
    """Compiles with a bar, and says how many loops it compiled."""
    with postponed() as functions:
        import mnsf_ros.drawing.color_wheel
        import mnsf_ros.methods
        import mnsf_ros.sweeps_io.flow_columns  # noqa: F401
    for file, finish in functions:
        _rest[file].append(finish)
    # Those with most functions first, for an equal load.
    files = sorted(_rest, key=lambda file: -len(_rest[file]))
    console, num_compiled = Console(stderr=True), 0
    # A worker that is forked has the functions already.
    context = multiprocessing.get_context("fork")
    with (
        context.Pool(min(len(files), os.cpu_count() or 1), _obey) as pool,
        counting_progress(console) as progress,
    ):
        task = progress.add_task("compiling loops for this computer", total=len(functions))
        for num_functions, num_new in pool.imap_unordered(_compile, files):
            progress.advance(task, num_functions)
            num_compiled += num_new
    console.say(f"loops compiled: {num_compiled}, there before: {len(functions) - num_compiled}")


def _obey() -> None:
    """A worker ends when the program does, which alone answers signals."""
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _compile(file: str) -> tuple[int, int]:
    """Returns the number of functions of a file, and of those that were not compiled yet."""
    return len(_rest[file]), sum(finish() for finish in _rest[file])


if __name__ == "__main__":
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, lambda number, _: sys.exit(128 + number))
    main()
