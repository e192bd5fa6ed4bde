# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""`mnsf evaluate` at work: inspects recordings, runs tasks, prints tables and writes the report."""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path

from mnsf_ros.cli.arguments import ALL, chosen_settings
from mnsf_ros.cli.console import Console, counting_progress
from mnsf_ros.errors import LibraryError, MethodError, MnsfError, SettingsError
from mnsf_ros.evaluation.findings import Findings
from mnsf_ros.evaluation.options import (
    EvaluatedMethod,
    EvaluationOptions,
    EvaluationTask,
    TaskKey,
    evaluated_methods,
)
from mnsf_ros.evaluation.parallel import Executor, executor
from mnsf_ros.evaluation.recordings import inspected_recordings, short_name
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_folder import RunFolder, check_folder
from mnsf_ros.evaluation.run_record import RunRecord, session_now
from mnsf_ros.evaluation.task import TaskFailed
from mnsf_ros.methods.registry import COMMAND_PREFIX
from mnsf_ros.report.page import write_report
from mnsf_ros.report.results_files import write_results
from mnsf_ros.report.run_results import RunResults, read_results

DEFAULT_METHODS = ("online", "mnsf")


def evaluate(options: argparse.Namespace, console: Console) -> bool:
    """Evaluates and prints, by the options of the command line, see `evaluate.add_evaluate`.

    Returns:
        False if a recording is damaged or has no example, if a method failed on all examples of
        one, if a task, a method or a recording had to be given up, or if there is no report.

    Raises:
        StoppedError: The run cannot go on.
        MnsfError: An argument, setting or recording cannot be used.
    """
    if options.out is None:
        if options.resume:
            raise SettingsError("--resume needs --out DIR, the folder of the interrupted run")
        options.out = _new_folder(options.bags)
    evaluation = _evaluation_options(options)
    check_folder(options.out, resume=options.resume)
    methods, failed = _methods(options, evaluation, console)
    evaluation = evaluation.for_methods(methods, pairs=options.pairs)
    pool = executor(options.workers, options.ray, options.num_gpus)
    recordings, unreadable = inspected_recordings(
        options.bags, options.points, options.truth, options.odometry
    )
    with pool as execute:
        folder = RunFolder(options.out)
        session = session_now(["mnsf", *sys.argv[1:]])
        record = RunRecord(evaluation, methods, recordings, [session])
        tasks = folder.begin(record, resume=options.resume)
        console.say(f"Results folder: {folder.path}")
        try:
            given_up = _run_tasks(tasks, evaluation, execute, folder, console)
        finally:
            # Also after Ctrl-C: what is finished is worth a table.
            number = evaluation.num_pictured
            is_complete = folder.has_results and _conclude(folder, number, console)
    given_up = [*failed, *unreadable, *given_up]
    for text in given_up:
        console.warn(text)
    return is_complete and not given_up


def _run_tasks(
    tasks: Sequence[EvaluationTask],
    evaluation: EvaluationOptions,
    execute: Executor,
    folder: RunFolder,
    console: Console,
) -> list[str]:
    """Writes down the events of tasks as they come; returns an error text for each failed task."""
    given_up: list[str] = []
    num_sweeps = {task.key: -(-task.recording.num_sweeps // evaluation.every) for task in tasks}
    done = Counter({task.key: len(task.skipped) for task in tasks})
    with counting_progress(console) as progress:
        bar = progress.add_task("evaluating sweeps", total=sum(num_sweeps.values()))
        for task, event in execute(tasks, evaluation):
            folder.take(task, event)
            if isinstance(event, ResultRow):
                done[task.key] += 1
            elif isinstance(event, TaskFailed):
                given_up.append(f"gave up {_title(task.key)}: {event.reason}")
            elif isinstance(event, Findings):
                text = f"{_title(task.key)}: done, examples: {done[task.key]}"
                console.say(text, soft_wrap=True)
                # The first and the last sweep of a recording make no example.
                done[task.key] = num_sweeps[task.key]
            progress.update(bar, completed=done.total())
    return given_up


def _title(key: TaskKey) -> str:
    recording, method = key
    return f"{method} on {recording}"


def _conclude(folder: RunFolder, num_pictured: int, console: Console) -> bool:
    """Writes and prints the results so far.

    Returns:
        Whether the results are complete and there is a report.

    Raises:
        WritingError: Results cannot be written.
    """
    results = read_results(folder)
    write_results(folder, results)
    _print_results(results, folder, console)
    try:
        path = write_report(folder, results, num_pictured)
    except Exception as error:  # noqa: BLE001 - the results are there, whatever a picture costs
        reason = str(error) if isinstance(error, MnsfError) else repr(error)
        console.warn(f"no report: {reason}; `mnsf report {folder.path}` tries again")
        return False
    console.say(f"Report: {path}")
    return not results.is_incomplete


def _print_results(results: RunResults, folder: RunFolder, console: Console) -> None:
    if results.table.empty:
        for text in ("No results.", *(note.text for note in results.notes)):
            console.warn(text)
        return
    for table in (*results.main_tables, *results.further_tables[-1:]):
        console.print(table)
    for text in results.protocol:
        console.say(text)
    for note in results.notes:
        (console.warn if note.is_incomplete else console.say)(note.text)
    console.say(f"Results: {folder.path / 'results.md'}")


def _new_folder(paths: Sequence[Path]) -> Path:
    """A folder named after the first recording, the number of others, and the time."""
    name = short_name(paths[0]) or "recording"
    more = f"+{len(paths) - 1}" if len(paths) > 1 else ""
    return Path(f"{name}{more}-{datetime.now():%Y%m%d-%H%M%S}")


def _methods(
    options: argparse.Namespace, evaluation: EvaluationOptions, console: Console
) -> tuple[list[EvaluatedMethod], list[str]]:
    """The named methods that work, and an error text for each other one.

    By default those whose libraries are installed.
    """
    names = _split(options.methods) if options.methods else DEFAULT_METHODS
    found: list[EvaluatedMethod] = []
    failed: list[str] = []
    for name in names:
        try:
            found += evaluated_methods([name], evaluation, is_remote=options.ray is not None)
        except LibraryError as error:
            if options.methods:
                raise
            console.warn(f"{name} is not evaluated: {error}")
        except MethodError as error:
            failed.append(str(error))
    if not found:
        raise MethodError("; ".join(failed))
    return found, failed


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
        num_pictured=max(0, options.pictures),
    )
