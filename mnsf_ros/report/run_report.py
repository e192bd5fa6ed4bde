"""The report of a run: pictures of the worst sweeps are found, and all is written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path

from mnsf_ros.drawing.example_pictures import PicturedExample
from mnsf_ros.errors import EvaluationError, MnsfError
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.report.cards import cards_of
from mnsf_ros.report.closer_look import closer_look
from mnsf_ros.report.page import REPORT_FILE, write_report
from mnsf_ros.report.pictured_flows import (
    TimeBudget,
    estimated_examples,
    num_estimates,
    recorded_examples,
)
from mnsf_ros.report.run_results import RunResults


def report_run(
    results: RunResults,
    folder: Path,
    *,
    num_pictured: int = 3,
    estimate_again: bool = True,
    limit_s: float = math.inf,
    focus: str | None = None,
    say: Callable[[str], None] = lambda text: None,
) -> Path:
    """Writes the report of a run into its folder.

    Where pictures take time, a report without any is written first: it is there whatever happens.

    Args:
        results: All that the run gave, finished or not.
        folder: Folder of the run.
        num_pictured: So many of the worst examples get pictures.
        estimate_again: Whether to estimate these again where the run wrote no flow.
        limit_s: Seconds that this may take. If there is a limit, examples far into a recording,
            or of a recording that would have to be inspected first, are left alone.
        focus: Method whose worst sweeps are shown; None for the first one with a flow that is no
            reference.
        say: Gets one line for each thing that takes time or cannot be done.

    Returns:
        The file.

    Raises:
        EvaluationError: The run has no such method.
        OSError: Writing fails.
    """
    try:
        look = closer_look(results, focus)
    except EvaluationError as error:
        raise EvaluationError(f"{folder}: {error}") from error
    path, record, wanted = folder / REPORT_FILE, results.record, look.first(num_pictured)
    methods = list(dict.fromkeys([look.method, *(one.method for one in results.summaries)]))
    pictured = recorded_examples(folder, wanted.rows, methods)
    why_not = ""
    if not pictured:
        why_not = _why_not_written(wanted.rows, num_pictured, estimate_again=estimate_again)
    write_report(results, path, look, cards_of(results.rows, wanted, pictured), why_not)
    if pictured or not estimate_again:
        return path
    if math.isfinite(limit_s):
        wanted = look.within_reach(record).first(num_pictured)
        # Other programs may take long, or do more than one expects of a picture.
        external = {method.name for method in record.methods if method.traits.is_external}
        methods = [method for method in methods if method not in external]
    if methods and wanted.rows:
        times_s = {summary.method: summary.time_ms / 1e3 for summary in results.summaries}
        budget = TimeBudget(limit_s, times_s)
        pictured, why_not = _estimated(record, wanted.rows, methods, budget, say)
        if why_not:
            say(why_not)
    write_report(results, path, look, cards_of(results.rows, wanted, pictured), why_not)
    return path


def _why_not_written(
    wanted: Sequence[ResultRow], num_pictured: int, *, estimate_again: bool
) -> str:
    """Why there are no pictures, unless flow is found or estimated again."""
    if num_pictured < 1:
        return "No pictures: none were asked for (--pictures)."
    if not wanted:
        return "No pictures: there is no flow to look at."
    text = "No pictures: the run wrote no flow (--write-flow), and "
    if estimate_again:
        return f"{text}no example can be estimated again soon; `mnsf report` on the folder can."
    return f"{text}nothing was estimated again; `mnsf report` on the folder does that."


def _estimated(
    record: RunRecord,
    wanted: Sequence[ResultRow],
    methods: Sequence[str],
    budget: TimeBudget,
    say: Callable[[str], None],
) -> tuple[list[PicturedExample], str]:
    """The examples that get ready in time, and why others do not."""
    if not record.is_of_this_version:
        return [], "No pictures: the run was made by another version of mnsf_ros."
    if not budget.allows(methods[0]):
        seconds = budget.needs_s(methods[0])
        why = f"No pictures: one flow takes {seconds:.0f} s; `mnsf report` on the folder waits."
        return [], why
    counts = num_estimates(record, wanted, methods, budget)
    seconds = sum(number * budget.needs_s(method) for method, number in counts.items())
    sweeps = "1 sweep" if len(wanted) == 1 else f"{len(wanted)} sweeps"
    say(
        f"estimating {sweeps} again for pictures by {', '.join(methods)}, about "
        f"{min(budget.limit_s, seconds):.0f} s"
    )
    try:
        found = estimated_examples(record, wanted, methods, budget)
    except MnsfError as error:
        return [], f"No pictures: {error}"
    missing = len(wanted) - len(found)
    if missing:
        which = f"{missing} of {len(wanted)} sweeps have no picture" if found else "No pictures"
        return found, (
            f"{which}: no flow got ready in time; `mnsf report` on the folder waits for it."
        )
    return found, ""
