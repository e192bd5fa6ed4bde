# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Progress bars on the terminal."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from mnsf_ros.recording.bag_writer import check_target
from mnsf_ros.simulation.recording import write_recording
from mnsf_ros.simulation.settings import SimulationSettings
from mnsf_ros.simulation.sweeps import SweepSimulator


def counting_progress(console: Console) -> Progress:
    """A bar with a text, `done/all` and the time left; add a task with its total to it."""
    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn())
    return Progress(*columns, TimeRemainingColumn(), console=console)


def simulate_with_progress(
    settings: SimulationSettings, path: Path, console: Console, *, overwrite: bool = False
) -> SweepSimulator:
    """Simulates a recording, shows how far it is, and returns its simulator.

    Raises:
        RecordingError: If it cannot be written.
    """
    check_target(path, overwrite=overwrite)
    with counting_progress(console) as progress:
        task = progress.add_task("simulating a street", total=None)

        def show(num_done: int, num_sweeps: int) -> None:
            progress.update(task, completed=num_done, total=num_sweeps)

        return write_recording(settings, path, show, overwrite=overwrite)
