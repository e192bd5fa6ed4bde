"""A closer look at one method: its worst sweeps, the movers that it missed, and tables of both."""

from __future__ import annotations

import math
from collections.abc import Iterable
from typing import Final, NamedTuple

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.movers import ObjectRow
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_record import RunRecord
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.text_table import NO_VALUE, TextTable, format_number, format_percent

_NUM_LISTED: Final = 10
_NANOSECONDS: Final = 1e9
# A long recording is read from its beginning to the example wanted.
_NEAR_SWEEPS: Final = 200


class MissedMover(NamedTuple):
    """A mover that was missed, in the sweep in which there was most to be seen of it."""

    row: ResultRow
    item: ObjectRow
    num_sweeps: int

    @property
    def lost_by(self) -> str:
        """What lost it, a dash if nobody says."""
        return NO_VALUE if self.item.lost_by is None else self.item.lost_by.value


class CloserLook(NamedTuple):
    """What to look at of a method.

    Attributes:
        method: Its name; empty if there is none.
        worst: Its rows that have a flow, the worst one first.
        missed: The movers that it did not find in some sweep, the one of most sweeps first.
    """

    method: str
    worst: list[ResultRow]
    missed: list[MissedMover]

    @classmethod
    def of(cls, rows: Iterable[ResultRow], method: str) -> CloserLook:
        """Looks at the rows of a method among those of others."""
        own = [row for row in rows if row.method == method]
        return cls(method, _worst_first(own), _missed_movers(own))

    @property
    def rows(self) -> list[ResultRow]:
        """Each sweep once, the worst ones first."""
        rows = [*self.worst, *(one.row for one in self.missed)]
        return list({(row.recording, row.number): row for row in rows}.values())

    def first(self, number: int) -> CloserLook:
        """Returns so many of each."""
        return self._replace(worst=self.worst[:number], missed=self.missed[:number])

    def within_reach(self, record: RunRecord) -> CloserLook:
        """Returns what is soon found: near the beginning, in recordings that are inspected."""
        worst = [row for row in self.worst if row.number < _NEAR_SWEEPS] or self.worst
        missed = [one for one in self.missed if one.row.number < _NEAR_SWEEPS] or self.missed
        known = {one.name for one in record.recordings if one.inspection is not None}
        if known:
            worst = [row for row in worst if row.recording in known]
            missed = [one for one in missed if one.row.recording in known]
        return self._replace(worst=worst, missed=missed)


def closer_look(results: RunResults, method: str | None = None) -> CloserLook:
    """Looks closely at a method; None for the one under test.

    That is the first one named that is no reference, if one has a flow the first of those.

    Raises:
        EvaluationError: The run has no such method.
    """
    rows, record = results.rows, results.record
    known = list(dict.fromkeys([*record.method_names, *(row.method for row in rows)]))
    if method is not None and method not in known:
        raise EvaluationError(f"has no method {method!r}; it has {', '.join(known) or 'none'}")
    if method is None:
        found = [summary.method for summary in results.summaries if summary.num_examples]
        rivals = [name for name in found if name not in record.references]
        named = [name for name in known if name not in record.references]
        method = next(iter(rivals or named or found), "")
    return CloserLook.of(rows, method)


def badness(row: ResultRow) -> float:
    """Returns how bad a flow is: its error, or without truth the distance it leaves; metres."""
    errors = row.errors.get("all")
    if errors is not None and errors.num_points > 0:
        return errors.epe_m
    return row.consistency.get("nearest_m", math.nan)


def _worst_first(rows: Iterable[ResultRow]) -> list[ResultRow]:
    known = [row for row in rows if row.failure is None and not math.isnan(badness(row))]
    return sorted(known, key=lambda row: (-badness(row), row.recording, row.number))


def _missed_movers(rows: Iterable[ResultRow]) -> list[MissedMover]:
    missed: dict[tuple[str, int], list[tuple[ResultRow, ObjectRow]]] = {}
    for row in rows:
        if row.movers is not None:
            for item in row.movers.objects:
                if item.moves and not item.is_found:
                    missed.setdefault((row.recording, item.object_id), []).append((row, item))
    most = (
        (*max(sweeps, key=lambda pair: (pair[1].num_points, -pair[0].number)), len(sweeps))
        for sweeps in missed.values()
    )
    return sorted((MissedMover(*one) for one in most), key=lambda one: -one.num_sweeps)


def worst_table(look: CloserLook) -> TextTable | None:
    """Returns the figures of the worst sweeps of a method; None if none can be judged."""
    worst = look.worst
    if not worst:
        return None
    has_truth = any(row.errors for row in worst)
    header = ["sweep", "points"]
    header += ["EPE (m)", "Acc5 (%)", "dynamic EPE (m)"] if has_truth else []
    header += ["to next sweep (m)", "time (ms)"]
    listed = [_cells(row, has_truth) for row in worst[:_NUM_LISTED]]
    title = f"The worst {len(listed)} of {len(worst)} sweeps of {look.method}"
    return TextTable(header, listed, title)


def _cells(row: ResultRow, has_truth: bool) -> list[str]:
    cells = [f"{row.recording}, sweep {row.number}", f"{row.num_points:,}"]
    if has_truth:
        errors, dynamic = row.errors.get("all"), row.errors.get("dynamic")
        cells += [
            "-" if errors is None else format_number(errors.epe_m, 3),
            "-" if errors is None else format_percent(errors.acc5),
            "-" if dynamic is None else format_number(dynamic.epe_m, 3),
        ]
    nearest_m = row.consistency.get("nearest_m", math.nan)
    return [*cells, format_number(nearest_m, 3), format_number(row.time_ms, 0)]


def missed_table(look: CloserLook) -> TextTable | None:
    """Returns the movers that a method missed most often; None if it missed none."""
    header = ["mover", "sweeps", "stamp (s)", "x, y (m)", "speed (m/s)", "points", "lost by"]
    listed = [
        [
            f"{one.row.recording}: {one.item.kind}",
            str(one.num_sweeps),
            f"{one.row.stamp_ns / _NANOSECONDS:.3f}",
            ", ".join(f"{value:.1f}" for value in one.item.place_m),
            f"{one.item.speed_m_s:.1f}",
            f"{one.item.num_points:,}",
            one.lost_by,
        ]
        for one in look.missed[:_NUM_LISTED]
    ]
    title = f"Movers that {look.method} missed in most sweeps (mnsf explain tells more of a place)"
    return TextTable(header, listed, title) if listed else None
