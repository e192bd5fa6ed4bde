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
from mnsf_ros.errors import MnsfError, RecordingError, SettingsError
from mnsf_ros.evaluation.options import (
    MAX_SWEEPS,
    EvaluatedRecording,
    EvaluationOptions,
    choose_topics,
    evaluated_methods,
)
from mnsf_ros.evaluation.results_files import RunResults, read_results, write_results
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import path_text
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
from mnsf_ros.evaluation.tables import main_tables, work_table
from mnsf_ros.methods.command_estimator import COMMAND_PREFIX
from mnsf_ros.recording.inspection import inspect_recording

_PAIR: Final = 2
_PICTURES_LIMIT_S: Final = 60.0


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
        _conclude(folder, recordings, options.pictures, console, estimate_again=False)
        raise
    # Nobody who sent the run to other machines wants this one to estimate.
    is_complete = _conclude(
        folder, recordings, options.pictures, console, estimate_again=options.ray is None
    )
    given_up = [f"gave up {' on '.join(key[::-1])}: {why}" for key, why in outcome.failed.items()]
    for text in (*given_up, *unreadable):
        _warn(console, text)
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


def _conclude(
    folder: RunFolder,
    recordings: Sequence[EvaluatedRecording],
    num_pictured: int,
    console: Console,
    *,
    estimate_again: bool,
) -> bool:
    """Writes and prints what the run gave so far; removes the folder of a run that gave nothing.

    Args:
        folder: The run.
        recordings: The recordings of the run.
        num_pictured: So many of the worst examples get pictures.
        console: Where to print.
        estimate_again: Whether to estimate these again, for a minute at most, where the run
            wrote no flow.

    Returns:
        Whether the results are complete and there is a report.

    Raises:
        WritingError: Results cannot be written.
    """
    if folder.remove_if_unused():
        return False
    results = read_results(folder)
    write_results(folder, results)
    _print_results(results, folder, console)
    is_reported = _write_report(
        results, folder, recordings, max(0, num_pictured), console, estimate_again
    )
    return is_reported and not results.is_incomplete


def _say(console: Console, text: str) -> None:
    """Prints a text as it is, whatever it holds."""
    console.print(text, markup=False, highlight=False)


def _warn(console: Console, text: str) -> None:
    """Prints a text that needs attention."""
    console.print(text, markup=False, highlight=False, style="yellow")


def _print_results(results: RunResults, folder: RunFolder, console: Console) -> None:
    if not results.summaries:
        for text in ("No results.", *map(str, results.notes)):
            _warn(console, text)
        return
    for table in [*main_tables(results.summaries), work_table(results.summaries)]:
        console.print(table)
    for text in results.protocol:
        _say(console, text)
    for note in results.notes:
        (_warn if note.kind.is_incomplete else _say)(console, note.text)
    _say(console, f"Results: {path_text(folder.path / 'results.md')}")


def _write_report(
    results: RunResults,
    folder: RunFolder,
    recordings: Sequence[EvaluatedRecording],
    num_pictured: int,
    console: Console,
    estimate_again: bool,
) -> bool:
    """Returns whether there is a report; what goes wrong costs no results."""
    from mnsf_ros.report.run_report import report_run

    try:
        path = report_run(
            results,
            folder.path,
            num_pictured=num_pictured,
            estimate_again=estimate_again,
            limit_s=_PICTURES_LIMIT_S,
            recordings=recordings,
            say=lambda text: _say(console, text),
        )
    except Exception as error:  # noqa: BLE001 - the results are there, whatever a picture costs
        reason = str(error) if isinstance(error, MnsfError) else repr(error)
        _warn(console, f"no report: {reason}; `mnsf report {path_text(folder.path)}` tries again")
        return False
    _say(console, f"Report: {path_text(path)}")
    return True
