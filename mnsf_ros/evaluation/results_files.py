"""The results of a run as files: Markdown for people, CSV and JSON for programs."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Iterator
from functools import cached_property
from typing import Final

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.mover_summary import FAST, SLOW
from mnsf_ros.evaluation.notes import Note, nearest_preset, notes_of, protocol_text
from mnsf_ros.evaluation.results import FinishedTask, MethodSummary, ResultRow, summarize
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file, to_json
from mnsf_ros.evaluation.run_record import RunRecord, SessionRecord
from mnsf_ros.evaluation.tables import further_tables, main_tables

_CSV_ERRORS: Final = tuple(field.name for field in dataclasses.fields(FlowErrors))
_CSV_COUNTS: Final = ("num_examples", "num_failed", "num_dropped")
_CSV_TIMES: Final = ("time_ms", "latency_ms")
_CSV_CONSISTENCY: Final = ("nearest_m", "zero_nearest_m", "cycle_m")
# Of `MoverSummary`; and of the groups of movers that targets are about, see `MOVER_GROUPS`.
_CSV_MOVERS: Final = (
    *("precision", "recall", "iou", "ghosts_per_sweep", "ghost_sweeps"),
    *("velocity_error_m_s", "direction_error_deg", "after_stop_s"),
)
_CSV_GROUPS: Final = {"fast": FAST.name, "slow": SLOW.name}
_CSV_GROUP: Final = ("found", "flicker", "delay_s")
_CSV_FIGURES: Final = (*_CSV_COUNTS, *_CSV_ERRORS, *_CSV_TIMES, *_CSV_CONSISTENCY)


@dataclasses.dataclass(frozen=True)
class RunResults:
    """All that a run gave.

    Attributes:
        record: What was run.
        rows: One for each example and method, by recording and sweep.
        summaries: One for each method.
        protocol: Sentences on what the figures are figures of.
        notes: What makes them less certain.
    """

    record: RunRecord
    rows: list[ResultRow]
    summaries: list[MethodSummary]
    protocol: list[str]
    notes: list[Note]

    @property
    def is_incomplete(self) -> bool:
        """Whether a recording was not evaluated as a whole."""
        return any(note.kind.is_incomplete for note in self.notes)

    @cached_property
    def by_recording(self) -> dict[str, list[MethodSummary]]:
        """Name of each recording to the summaries of the methods on it alone."""
        rows_of: dict[str, list[ResultRow]] = {one.name: [] for one in self.record.recordings}
        for row in self.rows:
            rows_of.setdefault(row.recording, []).append(row)
        order = self.record.method_names
        return {name: summarize(rows, order) for name, rows in rows_of.items()}


def read_results(folder: RunFolder) -> RunResults:
    """Reads what a run has given so far.

    Raises:
        EvaluationError: There is no run, or its files are damaged.
    """
    return results_of(folder.read_record(), folder.rows(), folder.read_finished().values())


def results_of(
    record: RunRecord, rows: Iterable[ResultRow], finished: Iterable[FinishedTask] = ()
) -> RunResults:
    """Returns what a run gave, from its rows in any order and what its tasks noticed."""
    rows = sorted(rows, key=lambda row: (row.recording, row.number, row.method))
    summaries = summarize(rows, record.method_names)
    protocol = protocol_text(record, summaries)
    return RunResults(record, rows, summaries, protocol, notes_of(record, finished, rows))


def write_results(folder: RunFolder, results: RunResults) -> None:
    """Writes results.md, results.csv and results.json, in place of those of an earlier session.

    Raises:
        WritingError: Writing fails; files that are not written yet are those of before.
    """
    for name, text in (
        ("results.md", results_markdown(results)),
        ("results.csv", results_csv(results)),
        ("results.json", results_json(results)),
    ):
        replace_file(folder.path / name, [text])


def results_markdown(results: RunResults) -> str:
    """Returns all tables with what they are tables of."""
    parts = ["# Scene flow evaluation", *results.protocol]
    parts += [
        table.markdown().rstrip("\n")
        for table in [*main_tables(results.summaries), *further_tables(results.summaries)]
    ]
    if results.notes:
        parts += ["## Notes", "\n".join(f"* {note}" for note in results.notes)]
    *earlier, last = results.record.sessions
    lines = session_lines(last)
    if earlier:
        lines.append(f"* sessions: {len(earlier) + 1}, see run.json")
    parts += ["## Run", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def results_csv(results: RunResults) -> str:
    """Returns one line for each method and group of points: of all recordings, then of each.

    The column `recording` is empty for all recordings together. How, with what and where figures
    were made is the same on every line; those of movers, which come last, are for all points.
    """
    origin = _origin(results.record)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    # What came later stands behind the rest, so that columns keep their places.
    added = [f"{kind}_{key}" for kind in _CSV_GROUPS for key in _CSV_GROUP]
    writer.writerow(("recording", "method", "points", *_CSV_FIGURES, *origin, *_CSV_MOVERS, *added))
    for recording, summaries in {"": results.summaries, **results.by_recording}.items():
        for summary in summaries:
            for cells in _csv_lines(summary):
                writer.writerow((recording, *cells, *origin.values(), *_mover_cells(summary)))
    return text.getvalue()


def _csv_lines(summary: MethodSummary) -> Iterator[list[object]]:
    groups = dict(summary.errors)
    groups |= {f"range up to {limit} m": item for limit, item in summary.by_range.items()}
    groups |= {f"speed up to {limit} m/s": item for limit, item in summary.by_speed.items()}
    counts = [getattr(summary, key) for key in _CSV_COUNTS]
    others = [_cell(getattr(summary, key)) for key in _CSV_TIMES]
    others += [_cell(summary.consistency.get(key, math.nan)) for key in _CSV_CONSISTENCY]
    for name, errors in groups.items() or (("", None),):
        values = ["" if errors is None else _cell(getattr(errors, key)) for key in _CSV_ERRORS]
        yield [summary.method, name, *counts, *values, *others]


def _mover_cells(summary: MethodSummary) -> Iterator[str]:
    movers = summary.movers
    for key in _CSV_MOVERS:
        yield _cell(math.nan if movers is None else getattr(movers, key))
    for name in _CSV_GROUPS.values():
        group = None if movers is None else movers.groups.get(name)
        for key in _CSV_GROUP:
            yield _cell(math.nan if group is None else getattr(group, key))


def _origin(run: RunRecord) -> dict[str, str]:
    """How, with what and where a run was made; what sessions do not agree on is listed."""
    options, sessions = run.options, run.sessions
    name, changes = nearest_preset(options.settings)
    return {
        "seed": str(options.seed),
        "preset": name,
        "changed_settings": "; ".join(f"{key} = {value}" for key, value in changes.items()),
        "num_threads": str(options.settings.compute.num_threads),
        "points_given": str(options.num_points or "all"),
        "ground": options.ground,
        "realtime_rate": str(options.realtime_rate or ""),
        "every": str(options.every),
        **{
            f"{package}_version": _each_once(one.versions.get(package, "") for one in sessions)
            for package in ("mnsf_ros", "torch")
        },
        "machine": _each_once(str(one.machine) for one in sessions),
        "git_commit": _each_once(one.git_commit or "" for one in sessions),
    }


def _each_once(texts: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(texts))


def results_json(results: RunResults) -> str:
    """Returns everything but the rows, which are in `rows.jsonl`."""
    document = {
        "protocol": results.protocol,
        "notes": results.notes,
        "methods": results.summaries,
        "by_recording": results.by_recording,
        "run": results.record,
    }
    return to_json(document, indent=2) + "\n"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def session_lines(session: SessionRecord) -> list[str]:
    """Returns the facts of a session as lines of Markdown."""
    facts = session.facts | {"command": f"`{' '.join(session.command)}`"}
    return [f"* {name}: {text}" for name, text in facts.items() if text != "``"]
