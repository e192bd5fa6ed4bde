"""What `mnsf evaluate` does: inspect, plan, run, report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from itertools import chain, count
from pathlib import Path
from typing import Final

from rich.console import Console

from mnsf_ros.cli.evaluate import DEFAULT_METHODS
from mnsf_ros.cli.evaluation_progress import checking_progress, evaluation_progress
from mnsf_ros.cli.evaluation_report import conclude, warn
from mnsf_ros.errors import RecordingError, SettingsError
from mnsf_ros.evaluation.options import (
    MAX_SWEEPS,
    EvaluatedRecording,
    EvaluationOptions,
    choose_topics,
    evaluated_methods,
)
from mnsf_ros.evaluation.run_start import (
    check_folder,
    known_recordings,
    recording_names,
    short_name,
    start_or_resume,
)
from mnsf_ros.evaluation.runner import (
    Executor,
    plan_runs,
    run_evaluation,
    run_serially,
)
from mnsf_ros.methods.command_estimator import COMMAND_PREFIX
from mnsf_ros.recording.inspection import inspect_recording

_PAIR: Final = 2


def evaluate(options: argparse.Namespace, evaluation: EvaluationOptions, console: Console) -> bool:
    """Evaluates and prints.

    Args:
        options: What the command line says, see `evaluate.add_to`.
        evaluation: How to evaluate.
        console: Where to print.

    Returns:
        False if a recording is damaged or has no example, if a method failed on all examples of
        one, if a task or a recording had to be given up, or if there is no report.

    Raises:
        MnsfError: Something that was given cannot be used, or results cannot be written.
    """
    check_folder(options.out, resume=options.resume)
    names = _split(options.methods or [DEFAULT_METHODS])
    methods = evaluated_methods(names, evaluation, is_remote=options.ray is not None)
    num_sweeps = max(evaluation.num_sweeps, *(method.traits.num_sweeps for method in methods))
    num_sweeps = _PAIR if options.pairs else min(num_sweeps, MAX_SWEEPS)
    evaluation = replace(evaluation, num_sweeps=num_sweeps)
    execute = _executor(options, evaluation)
    recordings, unreadable = _inspected(options, console)
    folder = start_or_resume(
        options.out, recordings, methods, evaluation, resume=options.resume, arguments=sys.argv
    )
    runs = plan_runs(recordings, methods, evaluation, folder)
    try:
        with evaluation_progress(console, runs, evaluation.every) as progress:
            outcome = run_evaluation(
                runs, evaluation, folder, execute=execute, watch=progress.watch
            )
    except BaseException:
        # Also after Ctrl-C: what is finished is worth a table, but nobody waits for pictures.
        conclude(folder, recordings, options.pictures, console, estimate_again=False)
        raise
    # Nobody who sent the run to other machines wants this one to estimate.
    is_complete = conclude(
        folder, recordings, options.pictures, console, estimate_again=options.ray is None
    )
    given_up = [f"gave up {' on '.join(key[::-1])}: {why}" for key, why in outcome.failed.items()]
    for text in (*given_up, *unreadable):
        warn(console, text)
    return is_complete and not given_up and not unreadable


def new_folder(paths: Sequence[Path]) -> Path:
    """Returns the name of a folder that is not there yet: recording, how many more, and time."""
    name = short_name(paths[0]) or "recording"
    more = f"+{len(paths) - 1}" if len(paths) > 1 else ""
    folder = f"{name}{more}-{datetime.now():%Y%m%d-%H%M%S}"
    names = chain([folder], (f"{folder}-{number}" for number in count(2)))
    return next(path for path in map(Path, names) if not path.exists())


def _split(texts: Sequence[str]) -> list[str]:
    """The methods named, each once; the rest of a text from `command:` on is one method."""
    methods: list[str] = []
    for text in texts:
        names, command, rest = text.partition(COMMAND_PREFIX)
        methods += [name.strip() for name in names.split(",")]
        methods += [command + rest] if command else []
    methods = list(dict.fromkeys(filter(None, methods)))
    if not methods:
        raise SettingsError("methods: got none, expected at least one")
    return methods


def _executor(options: argparse.Namespace, evaluation: EvaluationOptions) -> Executor:
    if options.workers < 1:
        raise SettingsError(f"workers: got {options.workers}, expected 1 or more")
    if options.ray is not None:
        from mnsf_ros.evaluation.ray_cluster import RayCluster

        num_gpus = options.num_gpus
        if num_gpus is None:
            num_gpus = float(evaluation.settings.compute.device == "cuda")
        return RayCluster(options.ray, num_gpus=num_gpus)
    if options.workers > 1:
        from mnsf_ros.evaluation.worker_processes import WorkerProcesses

        return WorkerProcesses(options.workers)
    return run_serially


def _inspected(
    options: argparse.Namespace, console: Console
) -> tuple[list[EvaluatedRecording], list[str]]:
    """The recordings that can be used, and why others cannot."""
    paths: Sequence[Path] = options.bags
    names = recording_names(paths, known_recordings(options.out))
    found, unreadable = [], []
    for path, name in zip(paths, names, strict=True):
        with checking_progress(console, name) as watch:
            try:
                inspection = inspect_recording(path, watch)
            except RecordingError as error:
                unreadable.append(str(error))
                continue
        found.append(
            choose_topics(inspection, name, options.points, options.truth, options.odometry)
        )
    if not found:
        raise RecordingError("; ".join(unreadable))
    return found, unreadable
