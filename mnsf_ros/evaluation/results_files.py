"""The results of a run as files: Markdown for people, CSV and JSON for programs."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.protocol_text import notes_text, protocol_text
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import MethodSummary, summarize
from mnsf_ros.evaluation.results_tables import further_tables, main_tables
from mnsf_ros.evaluation.row_json import plain
from mnsf_ros.evaluation.run_folder import RunFolder

_CSV_ERRORS: Final = tuple(field.name for field in dataclasses.fields(FlowErrors))
_CSV_COUNTS: Final = ("num_examples", "num_failed", "num_dropped")
_CSV_TIMES: Final = ("time_ms", "latency_ms")
_CSV_CONSISTENCY: Final = ("nearest_m", "zero_nearest_m", "cycle_m")
_CSV_HEADER: Final = (
    *("method", "points"),
    *_CSV_COUNTS,
    *_CSV_ERRORS,
    *_CSV_TIMES,
    *_CSV_CONSISTENCY,
)


@dataclasses.dataclass(frozen=True)
class RunResults:
    """All that a run gave.

    Attributes:
        run: What was run, see `run.json`.
        rows: One for each example and method, by recording and sweep.
        summaries: One for each method.
        protocol: Sentences on what the figures are figures of.
        notes: Lines on what makes them less certain.
    """

    run: dict[str, Any]
    rows: list[ResultRow]
    summaries: list[MethodSummary]
    protocol: list[str]
    notes: list[str]


def read_results(folder: RunFolder) -> RunResults:
    """Reads what a run has given so far.

    Raises:
        EvaluationError: There is no run, or its files are damaged.
    """
    run = folder.read_run()
    rows = sorted(folder.rows(), key=lambda row: (row.recording, row.number, row.method))
    summaries = summarize(rows, run["methods"])
    notes = notes_text(run, folder.read_finished().values(), rows)
    return RunResults(run, rows, summaries, protocol_text(run, summaries), notes)


def write_results(folder: RunFolder, results: RunResults) -> None:
    """Writes results.md, results.csv and results.json, in place of those of an earlier session.

    Raises:
        OSError: Writing fails.
    """
    for name, text in (
        ("results.md", results_markdown(results)),
        ("results.csv", results_csv(results.summaries)),
        ("results.json", results_json(results)),
    ):
        (folder.path / name).write_text(text, encoding="utf-8")


def results_markdown(results: RunResults) -> str:
    """Returns all tables with what they are tables of."""
    parts = ["# Scene flow evaluation", *results.protocol]
    parts += [
        table.markdown().rstrip("\n")
        for table in [*main_tables(results.summaries), *further_tables(results.summaries)]
    ]
    if results.notes:
        parts += ["## Notes", "\n".join(f"* {note}" for note in results.notes)]
    parts += ["## Run", "\n".join(f"* {line}" for line in _run_lines(results.run))]
    return "\n\n".join(parts) + "\n"


def results_csv(summaries: Sequence[MethodSummary]) -> str:
    """Returns one line for each method and group of points."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(_CSV_HEADER)
    for summary in summaries:
        groups = dict(summary.errors)
        groups |= {f"range up to {limit} m": item for limit, item in summary.by_range.items()}
        groups |= {f"speed up to {limit} m/s": item for limit, item in summary.by_speed.items()}
        counts = [getattr(summary, key) for key in _CSV_COUNTS]
        others = [_cell(getattr(summary, key)) for key in _CSV_TIMES]
        others += [_cell(summary.consistency.get(key, math.nan)) for key in _CSV_CONSISTENCY]
        for name, errors in groups.items() or (("", None),):
            values = ["" if errors is None else _cell(getattr(errors, key)) for key in _CSV_ERRORS]
            writer.writerow([summary.method, name, *counts, *values, *others])
    return text.getvalue()


def results_json(results: RunResults) -> str:
    """Returns everything but the rows, which are in `rows.jsonl`."""
    recordings = [recording["name"] for recording in results.run["recordings"]]
    by_recording = {
        name: summarize((r for r in results.rows if r.recording == name), results.run["methods"])
        for name in recordings
    }
    document = {
        "protocol": results.protocol,
        "notes": results.notes,
        "methods": [dataclasses.asdict(summary) for summary in results.summaries],
        "by_recording": {
            name: [dataclasses.asdict(summary) for summary in summaries]
            for name, summaries in by_recording.items()
        },
        "run": results.run,
    }
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def _run_lines(run: Mapping[str, Any]) -> list[str]:
    session = run["sessions"][-1]
    machine, versions = session["machine"], session["versions"]
    lines = [f"started {session['started']}"]
    if session["command"]:
        lines.append(f"command: `{' '.join(session['command'])}`")
    lines.append(f"machine: {machine['name']}, {machine['processor']}, {machine['cores']} cores")
    if machine["gpu"]:
        lines[-1] += f", {machine['gpu']}"
    lines.append("versions: " + ", ".join(f"{name} {value}" for name, value in versions.items()))
    lines.append(f"git commit: {session['git_commit'] or 'none, not a checkout'}")
    if len(run["sessions"]) > 1:
        lines.append(f"sessions: {len(run['sessions'])}, see run.json")
    return lines
