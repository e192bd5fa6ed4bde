# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf doctor`: what a recording is, and what of it does not fit the method."""

import argparse
import json
from contextlib import suppress
from typing import TYPE_CHECKING, Final

from mnsf_ros.cli.arguments import Arguments, chosen_settings
from mnsf_ros.cli.console import Console
from mnsf_ros.evaluation.recordings import EvaluatedRecording, chosen_recordings
from mnsf_ros.input_check.finding import Severity

if TYPE_CHECKING:
    from mnsf_ros.evaluation.examination import Examination

EXIT_FINDINGS: Final = 1
_MARKS: Final = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "note"}
_MAX_NOTES: Final = 5
_EPILOG: Final = """\
Examples:
  mnsf doctor recording --points /lidar/points
  mnsf doctor recording --json | jq .findings

Exit status: 0: nothing wrong was found; 1: a warning or an error was.
What is checked: docs/reliability.md.
"""


def add_doctor(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.existing("bag BAG", "recording")
    arguments.points()
    arguments.value("--odometry TOPIC", "sensor poses, compared with the motion of the clouds")
    arguments.value("--duration-s S", "how much of the recording is read", duration, 60.0)
    arguments.flag("--json", "print JSON")
    arguments.settings(default="online")
    return _EPILOG


def run_doctor(options: argparse.Namespace) -> int:
    """Prints the examination; returns the exit status."""
    from mnsf_ros.evaluation.examination import examined

    (recording,) = chosen_recordings([options.bag], options.points, options.odometry)
    found = examined(recording, chosen_settings(options), options.duration_s)
    (_print_json if options.json else _print_text)(recording, found)
    return EXIT_FINDINGS if found.is_wrong else 0


def duration(text: str) -> float:
    """Returns seconds.

    Raises:
        ArgumentTypeError: The text is no number above 0.
    """
    with suppress(ValueError):
        if float(text) > 0:
            return float(text)
    raise argparse.ArgumentTypeError(f"got {text!r}, expected a number above 0")


def _print_text(recording: EvaluatedRecording, found: "Examination") -> None:
    console = Console()
    width = max(map(len, found.facts), default=0)
    for name, text in found.facts.items():
        console.say(f"{name:{width}}  {text}")
    console.say("")
    for finding in found.findings:
        style = "yellow" if finding.severity else None
        console.say(f"{_MARKS[finding.severity]}: {finding.found}", style)
        console.say(f"  {finding.remedy}")
    if not found.is_wrong:
        notes = f"; notes: {len(found.findings)}" if found.findings else ""
        console.say(f"Nothing wrong was found{notes}.")
    for note in found.notes[:_MAX_NOTES]:
        console.say(f"read: {note}")


def _print_json(recording: EvaluatedRecording, found: "Examination") -> None:
    findings = [
        {
            "severity": _MARKS[one.severity],
            "assumption": one.assumption,
            "found": one.found,
            "remedy": one.remedy,
        }
        for one in found.findings
    ]
    content = {"recording": recording.path, "points": recording.points, "facts": found.facts}
    print(json.dumps({**content, "findings": findings, "notes": found.notes}, indent=2))
