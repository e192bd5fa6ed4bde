# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The `mnsf` command and its subcommands."""

import argparse
import io
import math
import os
import signal
import sys
from contextlib import suppress
from importlib import import_module
from types import FrameType
from typing import Final

from mnsf_ros import __version__
from mnsf_ros.cli.arguments import Arguments, Parser
from mnsf_ros.cli.console import complain, show_warnings
from mnsf_ros.cli.memory import add_max_memory, limited_memory
from mnsf_ros.core.compute_device import let_threads_sleep
from mnsf_ros.errors import MnsfError, did_you_mean, is_caused_by, reason

# Name to summary and module, in the order of the help. The module of a command NAME has `add_NAME`,
# which declares its arguments and returns the end of its help, and `run_NAME`, which gets them and
# returns the exit status, or None for 0. It is imported for this command only. Slow imports are in
# `run_NAME`, so that wrong arguments are reported at once.
COMMANDS: Final = {
    "view": ("show the flow of a recording, or of the running node, in a browser", "view"),
    "play": ("publish the messages of a recording", "recordings"),
    "doctor": (
        "say what a recording or topic is, what does not fit the method, and what mends it",
        "doctor",
    ),
    "evaluate": ("score methods on recordings, print tables and write a report", "evaluate"),
    "estimate": ("write the flow of a recording as a recording, for any viewer", "estimate"),
    "explain": ("explain why one place of one sweep was called dynamic or not", "explain"),
    "report": ("write the HTML report of an evaluation again, from its rows.jsonl", "evaluate"),
    "study": ("reproduce a table or case study of the paper: NAME.md, NAME.csv", "study"),
    "tune": ("find the best settings of the method online for recordings (Optuna)", "tune"),
    "simulate": ("write a recording of a simulated street with its true flow", "recordings"),
    "convert": (
        "write a sequence of a public data set as a recording with true flow",
        "recordings",
    ),
    "export": ("write estimates of any method as files of OpenSceneFlow or Argoverse 2", "export"),
    "parameters": ("print all settings of a preset", "parameters"),
}

# They read no files of others.
_WITHOUT_LIMIT = ("simulate", "parameters")

_SIGNALS = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)

_met: list[int] = []

EXIT_USAGE = 2
EXIT_MEMORY = 3
EXIT_INTERRUPTED = 130


def main(arguments: list[str] | None = None) -> None:
    """Runs a subcommand and ends the process.

    Exit status 0: done; 2: an argument or file cannot be used, reported in one line; 3: memory
    limit; 130: interrupted; others depend on the subcommand.
    """
    # What nohup ignores stays so.
    heard = [number for number in _SIGNALS if signal.getsignal(number) is not signal.SIG_IGN]
    for number in heard:
        signal.signal(number, _interrupt)
    _print_any_text()
    show_warnings()
    let_threads_sleep()
    try:
        status = run(arguments)
    finally:
        # Python takes a while to end, and answers an interruption of that with a traceback.
        for number in heard:
            signal.signal(number, _leave)
        for stream in filter(None, (sys.stdout, sys.stderr)):
            with suppress(OSError, ValueError):
                stream.flush()
    if status == EXIT_INTERRUPTED:
        # With -m, Python would end itself by SIGINT instead, whatever the status.
        os._exit(status)
    sys.exit(status)


def run(arguments: list[str] | None = None) -> int:
    """Runs a subcommand and returns the exit status."""
    hint = ""
    _met.clear()
    try:
        options = _parsed(sys.argv[1:] if arguments is None else arguments)
        with limited_memory(getattr(options, "max_memory", math.inf)) as hint:
            return options.run(options) or 0
    except (Exception, KeyboardInterrupt) as error:
        # A library that a signal meets makes it another error, some without naming the cause.
        if _met or is_caused_by(error, KeyboardInterrupt):
            complain("interrupted")
            return EXIT_INTERRUPTED
        if is_caused_by(error, MemoryError):
            complain(f"{str(error) or 'out of memory'}; {hint}")
            return EXIT_MEMORY
        if not isinstance(error, (MnsfError, OSError)):
            raise
        if isinstance(error, BrokenPipeError):
            # The reader of the output has ended, such as `head`: the rest is discarded.
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            return 0
        file = getattr(error, "filename", None)
        complain(error if file is None else f"{file}: {reason(error)}")
        return EXIT_USAGE


def _parsed(arguments: list[str]) -> argparse.Namespace:
    name = next(iter(arguments), "")
    if name not in COMMANDS:
        overview = _overview()
        if not arguments:
            overview.print_help(sys.stderr)
            sys.exit(EXIT_USAGE)
        if not name.startswith("-"):
            hint = did_you_mean(name, COMMANDS) or f"; expected one of {', '.join(COMMANDS)}"
            overview.error(f"no command {name!r}{hint}")
        # Shows the help or the version, or what is wrong.
        return overview.parse_args(arguments)
    summary, module = COMMANDS[name]
    parser = Parser(
        prog=f"mnsf {name}",
        description=f"{summary[0].upper()}{summary[1:]}.",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    commands = import_module(f"mnsf_ros.cli.{module}")
    parser.epilog = getattr(commands, f"add_{name}")(Arguments(parser))
    parser.set_defaults(run=getattr(commands, f"run_{name}"))
    if name not in _WITHOUT_LIMIT:
        add_max_memory(Arguments(parser))
    # Options may stand anywhere, also between recordings.
    return parser.parse_intermixed_args(arguments[1:])


def _overview() -> Parser:
    lines = "\n".join(f"  {name:<12}{summary}" for name, (summary, _) in COMMANDS.items())
    parser = Parser(
        prog="mnsf",
        usage="%(prog)s COMMAND ...",
        description="Lidar scene flow: the motion of every point.",
        epilog=f"commands (mnsf COMMAND --help has the options):\n{lines}",
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--version", action="version", version=f"mnsf_ros {__version__}")
    parser.add_argument("command", choices=COMMANDS, metavar="COMMAND", help="see below")
    return parser


def _print_any_text() -> None:
    r"""Shows characters that the terminal's encoding does not know as `\xff`."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


def _interrupt(number: int, _frame: FrameType | None) -> None:
    """Makes any signal a Ctrl-C, so that child processes end and drafts are removed."""
    _met.append(number)
    raise KeyboardInterrupt


def _leave(_number: int, _frame: FrameType | None) -> None:
    os._exit(EXIT_INTERRUPTED)
