# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What `mnsf evaluate` does and prints: inspect, run, report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from datetime import datetime
from functools import partial
from itertools import chain, count
from pathlib import Path

from mnsf_ros.cli.arguments import ALL, chosen_settings
from mnsf_ros.cli.console import Console
from mnsf_ros.cli.evaluate import DEFAULT_METHODS
from mnsf_ros.cli.evaluation_progress import EvaluationProgress, checking_progress, task_title
from mnsf_ros.errors import LibraryError, MnsfError, SettingsError
from mnsf_ros.evaluation.executors import Executor, WorkerProcesses, run_serially
from mnsf_ros.evaluation.options import (
    EvaluatedMethod,
    EvaluationOptions,
    EvaluationTask,
    evaluated_methods,
)
from mnsf_ros.evaluation.recordings import inspected_recordings, path_text, short_name
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.shown_flows import FLOW_FOLDER
from mnsf_ros.evaluation.task import TaskFailed
from mnsf_ros.methods.registry import COMMAND_PREFIX
from mnsf_ros.report.page import write_report
from mnsf_ros.report.results_files import write_results
from mnsf_ros.report.run_results import RunResults, read_results
from mnsf_ros.report.run_tables import RunTables, tables_of


def evaluate(options: argparse.Namespace, console: Console) -> bool:
    """Evaluates and prints; `options` are those of the command line, see `evaluate.add_to`.

    Returns:
        False if a recording is damaged or has no example, if a method failed on all examples of
        one, if a task or a recording had to be given up, or if there is no report.

    Raises:
        MnsfError: Something that was given cannot be used, or results cannot be written.
    """
    if options.out is None:
        if options.resume:
            raise SettingsError("--resume needs --out DIR, the folder of the interrupted run")
        options.out = new_folder(options.bags)
    evaluation = _evaluation_options(options)
    execute = _executor(options, evaluation)
    folder = RunFolder(options.out)
    with folder.opened(resume=options.resume):
        methods = _methods(options, evaluation, console)
        recordings, unreadable = inspected_recordings(
            options.bags,
            folder.before.recordings if folder.before is not None else (),
            *(options.points, options.truth, options.odometry),
            watching=partial(checking_progress, console),
        )
        evaluation = evaluation.for_methods(methods, pairs=options.pairs)
        session = SessionRecord.now(sys.argv)
        tasks = folder.begin(RunRecord(evaluation, methods, recordings, [session]))
        console.say(f"Results folder: {path_text(folder.path)}")
        for key in sorted(folder.anew):
            console.say(f"{task_title(key)}: cannot go on in the middle, starts again")
        try:
            given_up = _run_tasks(tasks, evaluation, execute, folder, console)
        finally:
            # Also after Ctrl-C: what is finished is worth a table.
            is_complete = folder.has_results and _conclude(folder, evaluation.num_pictured, console)
    for text in (*given_up, *unreadable):
        console.warn(text)
    return is_complete and not given_up and not unreadable


def _run_tasks(
    tasks: Sequence[EvaluationTask],
    evaluation: EvaluationOptions,
    execute: Executor,
    folder: RunFolder,
    console: Console,
) -> list[str]:
    """Writes down what tasks give as it gets ready; returns which were given up, and why."""
    given_up: list[str] = []
    with EvaluationProgress(console, tasks, evaluation.every) as progress:
        for task, event in execute(tasks, evaluation):
            folder.take(task, event)
            progress.watch(task, event)
            if isinstance(event, TaskFailed):
                given_up.append(f"gave up {task_title(task.key)}: {event.reason}")
    return given_up


def _conclude(folder: RunFolder, num_pictured: int, console: Console) -> bool:
    """Writes and prints what the run gave so far.

    Returns:
        Whether the results are complete and there is a report.

    Raises:
        WritingError: Results cannot be written.
    """
    results = read_results(folder)
    tables = tables_of(results)
    write_results(folder, results, tables)
    _print_results(results, tables, folder, console)
    try:
        path = write_report(folder, results, tables, num_pictured)
    except Exception as error:  # noqa: BLE001 - the results are there, whatever a picture costs
        reason = str(error) if isinstance(error, MnsfError) else repr(error)
        console.warn(f"no report: {reason}; `mnsf report {path_text(folder.path)}` tries again")
        return False
    console.say(f"Report: {path_text(path)}")
    return not results.is_incomplete


def _print_results(
    results: RunResults, tables: RunTables, folder: RunFolder, console: Console
) -> None:
    if not results.summaries:
        for text in ("No results.", *map(str, results.notes)):
            console.warn(text)
        return
    for table in (*tables.main, *tables.consistency, *tables.comparison, *tables.work):
        console.print(table)
    for text in results.protocol:
        console.say(text)
    for note in results.notes:
        (console.warn if note.kind.is_incomplete else console.say)(note.text)
    console.say(f"Results: {path_text(folder.path / 'results.md')}")


def new_folder(paths: Sequence[Path]) -> Path:
    """Returns the name of a folder that is not there yet: recording, how many more, and time."""
    name = short_name(paths[0]) or "recording"
    more = f"+{len(paths) - 1}" if len(paths) > 1 else ""
    folder = f"{name}{more}-{datetime.now():%Y%m%d-%H%M%S}"
    names = chain([folder], (f"{folder}-{number}" for number in count(2)))
    return next(path for path in map(Path, names) if not path.exists())


def _methods(
    options: argparse.Namespace, evaluation: EvaluationOptions, console: Console
) -> list[EvaluatedMethod]:
    """The methods that are named; else those of the default whose libraries are installed."""
    ask = partial(evaluated_methods, options=evaluation, is_remote=options.ray is not None)
    if options.methods:
        return ask(_split(options.methods))
    found: list[EvaluatedMethod] = []
    for name in DEFAULT_METHODS:
        try:
            found += ask([name])
        except LibraryError as error:
            console.warn(f"{name} is not evaluated: {error}")
    return found


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


def _evaluation_options(options: argparse.Namespace) -> EvaluationOptions:
    return EvaluationOptions(
        settings=chosen_settings(options),
        num_points=None if options.num_points == ALL else options.num_points,
        every=options.every,
        seed=options.seed,
        ground=options.ground,
        realtime_rate=options.realtime,
        check_cycle=options.check_cycle,
        flow_folder=options.out / FLOW_FOLDER if options.write_flow else None,
        num_pictured=max(0, options.pictures),
    )


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
        return WorkerProcesses(options.workers)
    return run_serially
