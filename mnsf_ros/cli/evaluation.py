# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""A run of `mnsf evaluate`, with what it prints."""

import argparse
import sys
from collections.abc import Sequence
from datetime import datetime
from pathlib import Path
from typing import Final

from mnsf_ros.cli.arguments import chosen, chosen_settings
from mnsf_ros.cli.console import Console, complain, counting_progress
from mnsf_ros.cli.evaluate import DEFAULT_METHODS, EXIT_INCOMPLETE
from mnsf_ros.errors import LibraryError, MethodError, MnsfError, SettingsError
from mnsf_ros.evaluation.options import (
    EvaluatedMethod,
    EvaluationOptions,
    EvaluationTask,
    evaluated_methods,
)
from mnsf_ros.evaluation.parallel import Events, executor
from mnsf_ros.evaluation.recordings import chosen_recordings, short_name
from mnsf_ros.evaluation.run_folder import RunFolder, StoppedError, check_folder
from mnsf_ros.evaluation.run_record import RunRecord, session_now
from mnsf_ros.evaluation.scoring import ResultRow
from mnsf_ros.evaluation.task import FinishedTask
from mnsf_ros.methods.registry import COMMAND_PREFIX
from mnsf_ros.report.page import write_report
from mnsf_ros.report.results_files import write_results
from mnsf_ros.report.run_results import RunResults, read_results

EXIT_STOPPED: Final = 4


def evaluate(options: argparse.Namespace) -> int:
    """Evaluates, and returns the exit status."""
    try:
        is_complete = _evaluate(options, Console())
    except StoppedError as error:
        complain(
            f"{error}. Finished results are kept; to continue, repeat the command with "
            f"--out {options.out} --resume"
        )
        return EXIT_STOPPED
    return 0 if is_complete else EXIT_INCOMPLETE


def _evaluate(options: argparse.Namespace, console: Console) -> bool:
    """Evaluates and prints; False if a recording or method has no or not all results."""
    if options.out is None:
        if options.resume:
            raise SettingsError("--resume needs --out DIR, the folder of the interrupted run")
        options.out = new_folder(options.bags)
    if options.realtime == 0:
        raise SettingsError("--realtime: got 0, expected more; without it no sweeps are dropped")
    evaluation = chosen(options, EvaluationOptions, settings=chosen_settings(options))
    check_folder(options.out, resume=options.resume)
    methods, given_up = _methods(options, evaluation, console)
    evaluation = evaluation.for_methods(methods, pairs=options.pairs)
    pool = executor(options.workers, options.ray, options.num_gpus)
    topics = (options.points, options.odometry)
    recordings = chosen_recordings(options.bags, *topics, unreadable=given_up)
    with pool as execute:
        folder = RunFolder(options.out)
        session = session_now(["mnsf", *sys.argv[1:]])
        record = RunRecord(evaluation, methods, recordings, [session])
        tasks = folder.begin(record, resume=options.resume)
        console.say(f"Results folder: {folder.path}")
        try:
            for task, event in _shown(tasks, execute(tasks, evaluation), evaluation, console):
                folder.take(event)
                if isinstance(event, FinishedTask) and event.failure:
                    given_up.append(f"gave up {_title(task)}: {event.failure}")
        finally:
            # Also after Ctrl-C: finished results get a table.
            is_complete = _conclude(folder, console)
    for text in given_up:
        console.warn(text)
    return is_complete and not given_up


def _shown(
    tasks: Sequence[EvaluationTask], events: Events, evaluation: EvaluationOptions, console: Console
) -> Events:
    """Yields the events, with a bar of sweeps and a line for each task that is done."""
    most = evaluation.max_examples or sys.maxsize
    num_sweeps = {
        task.key: min(-(-task.recording.num_sweeps // evaluation.every), most) for task in tasks
    }
    done = {task.key: len(task.skipped) for task in tasks}
    with counting_progress(console) as progress:
        bar = progress.add_task("evaluating sweeps", total=sum(num_sweeps.values()))
        for task, event in events:
            yield task, event
            if isinstance(event, ResultRow):
                done[task.key] += 1
            elif isinstance(event, FinishedTask) and not event.failure:
                text = f"{_title(task)}: done, examples: {event.num_examples}"
                console.say(text)
                # The first and the last sweep of a recording make no example.
                done[task.key] = num_sweeps[task.key]
            progress.update(bar, completed=sum(done.values()))


def _title(task: EvaluationTask) -> str:
    return f"{task.method.name} on {task.recording.name}"


def _conclude(folder: RunFolder, console: Console) -> bool:
    """Writes and prints the results so far; False if they are not complete, or have no report."""
    results = read_results(folder)
    write_results(folder, results)
    _print_results(results, folder, console)
    try:
        path = write_report(folder, results)
    except Exception as error:  # noqa: BLE001 - the results are complete without a report
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


def new_folder(paths: Sequence[Path]) -> Path:
    """Returns a folder named after the first recording, the number of others, and the time."""
    name = short_name(paths[0]) or "recording"
    more = f"+{len(paths) - 1}" if len(paths) > 1 else ""
    return Path(f"{name}{more}-{datetime.now():%Y%m%d-%H%M%S}")


def _methods(
    options: argparse.Namespace, evaluation: EvaluationOptions, console: Console
) -> tuple[list[EvaluatedMethod], list[str]]:
    """The named methods that work, by default those installed, and an error text of each other."""
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
