"""The report of a run's folder: rows and record are read, pictures are found, all is written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.prediction_files import PREFIX
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import mean
from mnsf_ros.evaluation.results_files import read_results
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.report.figures_section import NO_FLOW
from mnsf_ros.report.flow_source import estimated_examples, options_of, recorded_examples
from mnsf_ros.report.pictured import PicturedExample, focus_method, worst_rows
from mnsf_ros.report.write_report import REPORT_FILE, write_report

Say = Callable[[str], None]


def report_run(
    folder: Path,
    *,
    num_pictured: int = 3,
    estimate_again: bool = True,
    focus: str | None = None,
    say: Say = lambda text: None,
) -> Path:
    """Writes the report of a run into its folder.

    Args:
        folder: Folder of the run, finished or not.
        num_pictured: So many of the worst examples get pictures.
        estimate_again: Whether to estimate these once more where the run wrote no flow.
        focus: Method whose worst examples are listed; None for the paper's if it is there.
        say: Gets one line for each thing that takes time or cannot be done.

    Returns:
        The file.

    Raises:
        EvaluationError: There is no run in the folder, or its files are damaged.
        OSError: Writing fails.
    """
    results = read_results(RunFolder(folder))
    rows, run = results.rows, results.run
    focus = focus or focus_method(rows, run["methods"])
    worst = worst_rows(rows, focus)[:num_pictured]
    others = {s.method: None for s in results.summaries if s.method not in (focus, NO_FLOW)}
    methods = [focus, *others]
    pictured = recorded_examples(folder, worst, methods)
    if worst and not pictured and estimate_again:
        pictured = _estimated(results.run, worst, methods, rows, say)
    path = folder / REPORT_FILE
    write_report(rows, run, path, pictured=pictured, focus=focus, notes=results.notes)
    return path


def _estimated(
    run: dict[str, object],
    worst: Sequence[ResultRow],
    methods: Sequence[str],
    rows: Sequence[ResultRow],
    say: Say,
) -> list[PicturedExample]:
    options = options_of(run)
    if options.has_memory:
        say(
            "no pictures: with warm start or in real time, flows cannot be estimated once more; "
            "run with --write-flow to keep them"
        )
        return []
    methods = [method for method in methods if not method.startswith(PREFIX)]
    times_ms = [mean([r.time_ms for r in rows if r.method == method]) for method in methods]
    seconds = len(worst) * sum(time for time in times_ms if not math.isnan(time)) / 1e3
    say(f"estimating the {len(worst)} worst examples once more for pictures, about {seconds:.0f} s")
    try:
        return estimated_examples(run, worst, methods)
    except MnsfError as error:
        say(f"no pictures: {error}")
        return []
