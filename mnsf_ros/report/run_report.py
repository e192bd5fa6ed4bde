"""The report of a run's folder: rows and record are read, pictures are found, all is written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from mnsf_ros.drawing.example_pictures import PicturedExample
from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluatedRecording
from mnsf_ros.evaluation.prediction_files import PREFIX
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import mean
from mnsf_ros.evaluation.results_files import read_results
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.report.figures_section import NO_FLOW
from mnsf_ros.report.flow_source import estimated_examples
from mnsf_ros.report.pictured import focus_method, worst_rows
from mnsf_ros.report.time_budget import TimeBudget
from mnsf_ros.report.write_report import REPORT_FILE, write_report
from mnsf_ros.report.written_flows import recorded_examples

Say = Callable[[str], None]

# A long recording is read from its beginning to the example wanted.
_NEAR_SWEEPS = 200


def report_run(
    folder: Path,
    *,
    num_pictured: int = 3,
    estimate_again: bool = True,
    limit_s: float = math.inf,
    recordings: Sequence[EvaluatedRecording] | None = None,
    focus: str | None = None,
    say: Say = lambda text: None,
) -> Path:
    """Writes the report of a run into its folder.

    Where pictures take time, a report without any is written first: it is there whatever happens.

    Args:
        folder: Folder of the run, finished or not.
        num_pictured: So many of the worst examples get pictures.
        estimate_again: Whether to estimate these once more where the run wrote no flow.
        limit_s: Seconds that this may take. If there is a limit, examples far into a recording
            are left alone.
        recordings: Those to estimate, as they were in the run; None to find out what is in all.
        focus: Method whose worst examples are listed; None for the paper's if it is there.
        say: Gets one line for each thing that takes time or cannot be done.

    Returns:
        The file.

    Raises:
        EvaluationError: There is no run in the folder, its files are damaged, or it has no such
            method.
        OSError: Writing fails.
    """
    results = read_results(RunFolder(folder))
    rows, run = results.rows, results.record
    known = list(dict.fromkeys([*run.method_names, *(row.method for row in rows)]))
    if focus is not None and focus not in known:
        raise EvaluationError(
            f"{folder}: has no method {focus!r}; it has {', '.join(known) or 'none'}"
        )
    focus = focus or focus_method(rows, run)
    worst = worst_rows(rows, focus)
    others = {s.method: None for s in results.summaries if s.method not in (focus, NO_FLOW)}
    methods = [focus, *others]
    path = folder / REPORT_FILE

    def write(pictured: Sequence[PicturedExample]) -> None:
        write_report(results, path, pictured=pictured, focus=focus)

    pictured = recorded_examples(folder, worst[:num_pictured], methods)
    write(pictured)
    if worst[:num_pictured] and not pictured and estimate_again:
        if math.isfinite(limit_s):
            worst = [row for row in worst if row.number < _NEAR_SWEEPS] or worst
        if recordings is not None:
            names = {recording.name for recording in recordings}
            worst = [row for row in worst if row.recording in names]
        budget = TimeBudget(limit_s, _seconds(rows))
        wanted = worst[:num_pictured]
        if pictured := _estimated(run, wanted, methods, budget, recordings, say):
            write(pictured)
    return path


def _seconds(rows: Sequence[ResultRow]) -> dict[str, float]:
    """Method to what an estimate took in the run."""
    times_ms: dict[str, list[float]] = {}
    for row in rows:
        times_ms.setdefault(row.method, []).append(row.time_ms)
    return {method: mean(times) / 1e3 for method, times in times_ms.items()}


def _estimated(
    run: RunRecord,
    wanted: Sequence[ResultRow],
    methods: Sequence[str],
    budget: TimeBudget,
    recordings: Sequence[EvaluatedRecording] | None,
    say: Say,
) -> list[PicturedExample]:
    methods = [method for method in methods if not method.startswith(PREFIX)]
    if not methods or not wanted:
        return []
    if not budget.allows(methods[0]):
        seconds = budget.needs_s(methods[0])
        say(
            f"no pictures: one flow takes {seconds:.0f} s; `mnsf report` on the folder waits for it"
        )
        return []
    seconds = min(budget.limit_s, len(wanted) * sum(map(budget.needs_s, methods)))
    examples = "1 example" if len(wanted) == 1 else f"{len(wanted)} examples"
    say(f"estimating {examples} once more for pictures, about {seconds:.0f} s")
    try:
        found = estimated_examples(run, wanted, methods, budget=budget, recordings=recordings)
    except MnsfError as error:
        say(f"no pictures: {error}")
        return []
    if not found:
        say("no pictures: no flow got ready in time; `mnsf report` on the folder waits for it")
    return found
