"""The report of a run: pictures of the worst sweeps are found, and all is written."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple, TypedDict

from mnsf_ros.drawing.example_pictures import PicturedExample
from mnsf_ros.errors import EvaluationError, MnsfError
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.evaluation.run_results import RunResults
from mnsf_ros.report.page import REPORT_FILE, write_report
from mnsf_ros.report.pictured_flows import TimeBudget, estimated_examples, recorded_examples
from mnsf_ros.report.worst import MissedMover, focus_method, missed_movers, worst_rows

# A long recording is read from its beginning to the example wanted.
_NEAR_SWEEPS = 200


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
        focus: Method whose worst sweeps are shown; None for `focus_method`.
        say: Gets one line for each thing that takes time or cannot be done.

    Returns:
        The file.

    Raises:
        EvaluationError: The run has no such method.
        OSError: Writing fails.
    """
    rows, record = results.rows, results.record
    known = list(dict.fromkeys([*record.method_names, *(row.method for row in rows)]))
    if focus is not None and focus not in known:
        raise EvaluationError(
            f"{folder}: has no method {focus!r}; it has {', '.join(known) or 'none'}"
        )
    focus = focus or focus_method(results)
    methods = list(dict.fromkeys([focus, *(summary.method for summary in results.summaries)]))
    path = folder / REPORT_FILE
    everything = _Wanted(worst_rows(rows, focus), missed_movers(rows, focus))
    wanted = everything.first(num_pictured)
    pictured = recorded_examples(folder, wanted.rows, methods)
    write_report(results, path, **wanted.found(pictured), focus=focus)
    if pictured or not estimate_again:
        return path
    if math.isfinite(limit_s):
        wanted = everything.within_reach(record).first(num_pictured)
        # Other programs may take long, or do more than one expects of a picture.
        external = {method.name for method in record.methods if method.traits.is_external}
        methods = [method for method in methods if method not in external]
    if methods and wanted.rows:
        times_s = {summary.method: summary.time_ms / 1e3 for summary in results.summaries}
        budget = TimeBudget(limit_s, times_s)
        pictured = _estimated(record, wanted.rows, methods, budget, say)
    if pictured:
        write_report(results, path, **wanted.found(pictured), focus=focus)
    return path


class _Wanted(NamedTuple):
    """What is to be pictured: the worst sweeps, and movers that were missed."""

    worst: list[ResultRow]
    missed: list[MissedMover]

    def first(self, number: int) -> _Wanted:
        """So many of each."""
        return _Wanted(self.worst[:number], self.missed[:number])

    def within_reach(self, record: RunRecord) -> _Wanted:
        """Those that are soon found: near the beginning, in recordings that are inspected."""
        worst = [row for row in self.worst if row.number < _NEAR_SWEEPS] or self.worst
        missed = [one for one in self.missed if one.row.number < _NEAR_SWEEPS] or self.missed
        known = {one.name for one in record.recordings if one.inspection is not None}
        if known:
            worst = [row for row in worst if row.recording in known]
            missed = [one for one in missed if one.row.recording in known]
        return _Wanted(worst, missed)

    @property
    def rows(self) -> list[ResultRow]:
        """Each sweep once, the worst ones first."""
        rows = [*self.worst, *(one.row for one in self.missed)]
        return list({(row.recording, row.number): row for row in rows}.values())

    def found(self, examples: Sequence[PicturedExample]) -> _Pictured:
        """The examples that got ready, as what they are wanted for."""
        by_key = {example.key: example for example in examples}
        worst = [(row.recording, row.number) for row in self.worst]
        missed = [(one, (one.row.recording, one.row.number)) for one in self.missed]
        return {
            "pictured": [by_key[key] for key in worst if key in by_key],
            "missed": [(one, by_key[key]) for one, key in missed if key in by_key],
        }


class _Pictured(TypedDict):
    pictured: list[PicturedExample]
    missed: list[tuple[MissedMover, PicturedExample]]


def _estimated(
    record: RunRecord,
    wanted: Sequence[ResultRow],
    methods: Sequence[str],
    budget: TimeBudget,
    say: Callable[[str], None],
) -> list[PicturedExample]:
    """The examples that get ready in time; says why there are none."""
    if not record.is_of_this_version:
        say("no pictures: the run was made by another version of mnsf_ros")
        return []
    if not budget.allows(methods[0]):
        seconds = budget.needs_s(methods[0])
        say(
            f"no pictures: one flow takes {seconds:.0f} s; `mnsf report` on the folder waits for it"
        )
        return []
    seconds = min(budget.limit_s, len(wanted) * sum(map(budget.needs_s, methods)))
    examples = "1 example" if len(wanted) == 1 else f"{len(wanted)} examples"
    say(f"estimating {examples} again for pictures, about {seconds:.0f} s")
    try:
        found = estimated_examples(record, wanted, methods, budget)
    except MnsfError as error:
        say(f"no pictures: {error}")
        return []
    if not found:
        say("no pictures: no flow got ready in time; `mnsf report` on the folder waits for it")
    return found
