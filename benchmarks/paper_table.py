# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's tables on four moments of KITTI raw drive 0005, beside what the authors' code gets.

    python benchmarks/paper_table.py [--out benchmark] [--plan 8192:mnsf,fnsf:3 full:mnsf:1]

Estimates with the preset `paper`, one thread; a plan is SCALE:METHODS:SEEDS, where METHODS may be
groups of paper_plan.py. Every row goes to OUT/rows.jsonl as it gets ready, and rows that are there
are not computed again: interrupt it and start it again as you like. Where the settings of a method
have changed since, --again METHODS computes its rows of the plan anew. At its end, or with --tables
alone, the tables are printed and written to --document. The data is looked for beside the
checkout, or where the environment variable MNSF_DATA says; without it nothing is done.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Collection
from dataclasses import replace
from pathlib import Path

# Before torch is loaded: whoever shares the machine gets the other cores.
os.environ.setdefault("OMP_NUM_THREADS", "1")

from kitti_examples import KittiExample, missing_data, read_example
from marked_section import add_document_option, replace_section
from paper_document import document, printed
from paper_plan import (
    PLAN,
    Job,
    PaperRecord,
    done_jobs,
    merged_settings,
    method_names,
    missing,
    outdated,
    planned,
)
from rich.console import Console

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_files import (
    ROWS_FILE,
    RUN_FILE,
    cut_off_unfinished_line,
    read_json,
    replace_file,
)
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_json import to_json
from mnsf_ros.evaluation.run_record import SessionRecord
from mnsf_ros.evaluation.scoring import failed_row, scored_row
from mnsf_ros.evaluation.task import warm_up
from mnsf_ros.methods import make_method


def main() -> None:
    """Does what is still to do, and writes the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=_Raw)
    parser.add_argument("--out", type=Path, default=Path("benchmark"), metavar="FOLDER")
    parser.add_argument("--plan", nargs="+", default=PLAN, metavar="SCALE:METHODS:SEEDS")
    parser.add_argument("--again", default="", metavar="METHODS", help="drop their rows first")
    add_document_option(parser)
    parser.add_argument("--tables", action="store_true", help="only print what is there")
    options = parser.parse_args()
    console = Console(width=120)
    if missing_data():
        console.print(f"Nothing to measure: {missing_data()}. Set MNSF_DATA to their folder.")
        return
    try:
        jobs = list(dict.fromkeys(job for part in options.plan for job in planned(part)))
    except ValueError as error:
        parser.error(str(error))
    folder = RunFolder(options.out)
    try:
        if not options.tables:
            folder.path.mkdir(parents=True, exist_ok=True)
            with folder.locked():
                run(jobs, folder, method_names(options.again), console)
    except KeyboardInterrupt:
        console.print("Interrupted; what is finished is kept.")
    except MnsfError as error:
        parser.error(str(error))
    rows = list(folder.rows)
    for table in printed(rows):
        console.print(table)
    if options.document:
        record = read_json(folder.path / RUN_FILE, PaperRecord)
        others = outdated(record.settings, {row.method: None for row in rows})
        # What is missing of the whole plan, whatever part of it this run was asked for.
        whole = dict.fromkeys(job for part in (*PLAN, *options.plan) for job in planned(part))
        text = document(rows, record.sessions, missing(whole, rows), others)
        replace_section(options.document, "paper tables", text)


def run(jobs: list[Job], folder: RunFolder, again: Collection[str], console: Console) -> None:
    """Computes the rows that are not there yet, and those of the methods to compute again."""
    cut_off_unfinished_line(folder.path / ROWS_FILE)
    folder.drop({(job.recording, job.method) for job in jobs if job.method in again})
    done = done_jobs(list(folder.rows))
    todo = [job for job in jobs if job not in done]
    if todo:
        file = folder.path / RUN_FILE
        earlier = read_json(file, PaperRecord) if done else PaperRecord([], {})
        settings = merged_settings(
            earlier.settings, {job.method for job in done}, {job.method for job in todo}
        )
        sessions = [*earlier.sessions, SessionRecord.now(sys.argv)]
        replace_file(file, [to_json(PaperRecord(sessions, settings), indent=2), "\n"])
    for number, job in enumerate(todo, start=1):
        row = measured(job, read_example(job.scale, job.moment))
        folder.add_row(row)
        result = (
            str(row.failure or "")
            or f"EPE {row.errors['all'].epe_m:.3f} m, {row.time_ms / 1e3:.1f} s"
        )
        place = f"{number}/{len(todo)} {job.scale} {job.method} seed {job.seed} {job.moment:03d}"
        console.print(f"{place}: {result}", highlight=False)


def measured(job: Job, example: KittiExample) -> ResultRow:
    """The result row of one estimate, or of its failure."""
    method = job.method.rpartition("/")[2]
    unscored = Example(job.recording, job.moment, example.triplet)
    try:
        estimator = make_method(method, job.settings)
        warm_up(method, job.settings)
        # Of the core, not of the clock: it may be lent to other work, or stopped, for a while.
        start = time.process_time()
        estimate = estimator.estimate(example.triplet)
        time_ms = (time.process_time() - start) * 1e3
    except MnsfError as error:
        return failed_row(unscored, job.method, str(error))
    row = scored_row(unscored, job.method, estimate, time_ms)
    return replace(row, errors=example.errors(estimate))


class _Raw(argparse.ArgumentDefaultsHelpFormatter, argparse.RawDescriptionHelpFormatter):
    """Keeps the lines of the docstring."""


if __name__ == "__main__":
    main()
