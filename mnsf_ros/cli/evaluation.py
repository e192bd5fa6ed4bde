"""What `mnsf evaluate` does and prints: inspect, plan, run, report."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from datetime import datetime
from functools import partial
from itertools import chain, count
from pathlib import Path
from typing import Final

from mnsf_ros.cli.console import Console
from mnsf_ros.cli.evaluation_progress import EvaluationProgress, checking_progress, task_title
from mnsf_ros.errors import MnsfError, SettingsError
from mnsf_ros.evaluation.executors import Executor, WorkerProcesses, run_serially
from mnsf_ros.evaluation.options import (
    MAX_SWEEPS,
    EvaluationOptions,
    TaskKey,
    evaluated_methods,
)
from mnsf_ros.evaluation.recordings import (
    EvaluatedRecording,
    inspected_recordings,
    path_text,
    short_name,
)
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.task import TaskFailed
from mnsf_ros.methods.registry import COMMAND_PREFIX
from mnsf_ros.report.comparison import comparison_tables
from mnsf_ros.report.results_files import write_results
from mnsf_ros.report.run_results import RunResults, read_results
from mnsf_ros.report.tables import main_tables, work_table

_PAIR: Final = 2
_PICTURES_LIMIT_S: Final = 60.0


def evaluate(options: argparse.Namespace, evaluation: EvaluationOptions, console: Console) -> bool:
    """Evaluates and prints; `options` are those of the command line, see `evaluate.add_to`.

    Returns:
        False if a recording is damaged or has no example, if a method failed on all examples of
        one, if a task or a recording had to be given up, or if there is no report.

    Raises:
        MnsfError: Something that was given cannot be used, or results cannot be written.
    """
    with RunFolder.opened(options.out, resume=options.resume) as folder:
        names = _split(options.methods)
        methods = evaluated_methods(names, evaluation, is_remote=options.ray is not None)
        num_sweeps = max(evaluation.num_sweeps, *(one.traits.num_sweeps for one in methods))
        num_sweeps = _PAIR if options.pairs else min(num_sweeps, MAX_SWEEPS)
        evaluation = replace(evaluation, num_sweeps=num_sweeps)
        execute = _executor(options, evaluation)
        recordings, unreadable = inspected_recordings(
            options.bags,
            folder.before.recordings if folder.before is not None else (),
            *(options.points, options.truth, options.odometry),
            watching=partial(checking_progress, console),
        )
        session = SessionRecord.now(sys.argv)
        tasks = folder.begin(RunRecord(evaluation, methods, recordings, [session]))
        console.say(f"Results folder: {path_text(folder.path)}")
        failed: dict[TaskKey, str] = {}
        try:
            with EvaluationProgress(console, tasks, evaluation.every) as progress:
                for task, event in execute(tasks, evaluation):
                    folder.take(task, event)
                    progress.watch(task, event)
                    if isinstance(event, TaskFailed):
                        failed[task.key] = event.reason
        except BaseException:
            # Also after Ctrl-C: what is finished is worth a table, but nobody waits for pictures.
            _conclude(folder, recordings, options.pictures, console, estimate_again=False)
            raise
        # Nobody who sent the run to other machines wants this one to estimate.
        is_complete = _conclude(
            folder, recordings, options.pictures, console, estimate_again=options.ray is None
        )
    given_up = [f"gave up {task_title(key)}: {why}" for key, why in failed.items()]
    for text in (*given_up, *unreadable):
        console.warn(text)
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
        return WorkerProcesses(options.workers)
    return run_serially


def _conclude(
    folder: RunFolder,
    recordings: Sequence[EvaluatedRecording],
    num_pictured: int,
    console: Console,
    *,
    estimate_again: bool,
) -> bool:
    """Writes and prints what the run gave so far.

    `num_pictured` of the worst examples get pictures. Where the run wrote no flow, these are
    estimated again if that is wanted, for a minute at most, from the `recordings` of this session.

    Returns:
        Whether the results are complete and there is a report.

    Raises:
        WritingError: Results cannot be written.
    """
    if not folder.has_results:
        return False
    results = read_results(folder)
    write_results(folder, results)
    _print_results(results, folder, console)
    from mnsf_ros.report.run_report import report_run

    inspected = {one.name: one for one in recordings}
    known = [inspected.get(one.name, one) for one in results.record.recordings]
    try:
        path = report_run(
            replace(results, record=replace(results.record, recordings=known)),
            folder.path,
            num_pictured=max(0, num_pictured),
            estimate_again=estimate_again,
            limit_s=_PICTURES_LIMIT_S,
            say=console.say,
        )
    except Exception as error:  # noqa: BLE001 - the results are there, whatever a picture costs
        reason = str(error) if isinstance(error, MnsfError) else repr(error)
        console.warn(f"no report: {reason}; `mnsf report {path_text(folder.path)}` tries again")
        return False
    console.say(f"Report: {path_text(path)}")
    return not results.is_incomplete


def _print_results(results: RunResults, folder: RunFolder, console: Console) -> None:
    if not results.summaries:
        for text in ("No results.", *map(str, results.notes)):
            console.warn(text)
        return
    tables = main_tables(results.summaries), comparison_tables(results)
    for table in (*chain(*tables), work_table(results.summaries)):
        console.print(table)
    for text in results.protocol:
        console.say(text)
    for note in results.notes:
        (console.warn if note.kind.is_incomplete else console.say)(note.text)
    console.say(f"Results: {path_text(folder.path / 'results.md')}")
