# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf doctor`: what a recording or a topic is, and what of it does not fit the method."""

import argparse
import json
from collections import Counter
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.cli.arguments import (
    ROS_NAME,
    Arguments,
    chosen_settings,
    existing_path,
    number_within,
)
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.errors import RecordingError
from mnsf_ros.evaluation.recordings import chosen_recordings
from mnsf_ros.input_check.finding import Severity
from mnsf_ros.settings import Settings

if TYPE_CHECKING:
    from mnsf_ros.evaluation.examination import Examination

EXIT_FINDINGS: Final = 1
_MARKS: Final = {Severity.ERROR: "error", Severity.WARNING: "warning", Severity.INFO: "note"}
_MAX_NOTES: Final = 5
_EPILOG: Final = """\
Examples:
  mnsf doctor recording --points /lidar/points
  mnsf doctor recording --json | jq .findings
  mnsf doctor /lidar/points --duration-s 20

Exit status: 0: nothing wrong was found; 1: a warning or an error was.
What is checked: docs/reliability.md.
"""


def add_doctor(arguments: Arguments) -> str:
    """Declares the arguments."""
    arguments.value("source BAG|TOPIC", "recording, or topic of a running lidar")
    arguments.points()
    arguments.value("--odometry TOPIC", "sensor poses, compared with the motion of the clouds")
    arguments.value("--duration-s S", "how much of it is read", number_within(1e-3, 1e9), 60.0)
    arguments.flag("--json", "print JSON")
    arguments.settings(default="online")
    return _EPILOG


def run_doctor(options: argparse.Namespace) -> int:
    """Prints the examination; returns the exit status."""
    settings = chosen_settings(options)
    if not _is_topic(options.source):
        paths = [_recording(options.source)]
        from mnsf_ros.evaluation.examination import examined

        (recording,) = chosen_recordings(paths, options.points, options.odometry)
        about = {"recording": recording.path, "points": recording.points}
        found = examined(recording, settings, options.duration_s)
    else:
        about = {"points": options.source}
        found = _examined_topic(options.source, options.odometry, settings, options.duration_s)
    if options.json:
        _print_json(about, found)
    else:
        _print_text(found)
    return EXIT_FINDINGS if found.is_wrong else 0


def _is_topic(source: str) -> bool:
    """Whether a source may be a topic: what is there is none, nor what begins with a folder."""
    if not ROS_NAME.fullmatch(source) or Path(source).exists():
        return False
    return source.count("/") == 1 or not Path("/", source.split("/")[1]).is_dir()


def _recording(source: str) -> Path:
    if not Path(source).exists() and "/" not in source and ROS_NAME.fullmatch(f"/{source}"):
        raise RecordingError(f"{source}: no such file or folder (a topic: /{source})")
    return existing_path(source)


def _examined_topic(
    topic: str, odometry: str | None, settings: Settings, duration_s: float
) -> "Examination":
    from mnsf_ros.node.environment import prepare_environment

    prepare_environment(is_node=True)
    console = Console(stderr=True)
    console.say(f"{topic}: no such file or folder, so it is taken for a topic")
    from mnsf_ros.evaluation.examination import Examiner
    from mnsf_ros.node.live_sweeps import live_sweeps

    if odometry is not None:
        settings = settings.changed({"ego_motion.source": "odometry"})
    examiner, events = Examiner(settings), Counter[str]()

    def report(_event: str, text: str, times: int = 1) -> None:
        events[text] += times

    with counting_progress(console) as progress:
        task = progress.add_task(f"listening to {topic}", total=None)
        for sweep, num_parts in live_sweeps(topic, odometry, settings, duration_s, report):
            examiner.check.add(sweep, num_parts)
            examiner.add(sweep)
            progress.advance(task)
    notes = [f"{text}: {number:,}" for text, number in events.items()]
    return examiner.examination({"topic": topic, "poses": odometry or "none"}, notes)


def _print_text(found: "Examination") -> None:
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


def _print_json(about: Mapping[str, str], found: "Examination") -> None:
    findings = [
        {
            "severity": _MARKS[one.severity],
            "assumption": one.assumption,
            "found": one.found,
            "remedy": one.remedy,
        }
        for one in found.findings
    ]
    content = {**about, "facts": found.facts, "findings": findings, "notes": found.notes}
    print(json.dumps(content, indent=2))
