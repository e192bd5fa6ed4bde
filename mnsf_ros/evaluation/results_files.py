"""The results of a run as files: Markdown for people, CSV and JSON for programs."""

from __future__ import annotations

import csv
import dataclasses
import io
import json
import math
from collections.abc import Iterable, Iterator, Mapping
from typing import Any, Final

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.nearest_preset import nearest_preset
from mnsf_ros.evaluation.notes_text import notes_text
from mnsf_ros.evaluation.protocol_text import protocol_text
from mnsf_ros.evaluation.result_row import ResultRow
from mnsf_ros.evaluation.results import MethodSummary, summarize
from mnsf_ros.evaluation.results_tables import further_tables, main_tables
from mnsf_ros.evaluation.row_json import plain
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file

_CSV_ERRORS: Final = tuple(field.name for field in dataclasses.fields(FlowErrors))
_CSV_COUNTS: Final = ("num_examples", "num_failed", "num_dropped")
_CSV_TIMES: Final = ("time_ms", "latency_ms")
_CSV_CONSISTENCY: Final = ("nearest_m", "zero_nearest_m", "cycle_m")
_CSV_FIGURES: Final = (*_CSV_COUNTS, *_CSV_ERRORS, *_CSV_TIMES, *_CSV_CONSISTENCY)


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
    parts += ["## Run", "\n".join(f"* {line}" for line in _run_lines(results.run))]
    return "\n\n".join(parts) + "\n"


def results_csv(results: RunResults) -> str:
    """Returns one line for each method and group of points: of all recordings, then of each.

    The column `recording` is empty for all recordings together. The last columns are the same on
    every line: how, with what and where the figures were made.
    """
    origin = _origin(results.run)
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(("recording", "method", "points", *_CSV_FIGURES, *origin))
    for recording, summaries in {"": results.summaries, **_by_recording(results)}.items():
        for summary in summaries:
            for cells in _csv_lines(summary):
                writer.writerow((recording, *cells, *origin.values()))
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


def _origin(run: Mapping[str, Any]) -> dict[str, str]:
    """How, with what and where a run was made; what sessions do not agree on is listed."""
    identity, sessions = run["identity"], run["sessions"]
    name, changes = nearest_preset(identity["settings"], identity["crop_and_ground"])
    machines = (_machine_text(session["machine"]) for session in sessions)
    commits = (session["git_commit"] or "" for session in sessions)
    return {
        "seed": str(identity["seed"]),
        "preset": name,
        "changed_settings": "; ".join(f"{key} = {value}" for key, value in changes.items()),
        "num_threads": str(identity["settings"]["compute.num_threads"]),
        "points_given": str(identity["num_points"]),
        "ground": identity["ground"],
        "realtime_rate": str(identity["realtime_rate"] or ""),
        "every": str(identity.get("every", 1)),
        **{
            f"{package}_version": _each_once(one["versions"].get(package, "") for one in sessions)
            for package in ("mnsf_ros", "torch")
        },
        "machine": _each_once(machines),
        "git_commit": _each_once(commits),
    }


def _each_once(texts: Iterable[str]) -> str:
    return "; ".join(dict.fromkeys(texts))


def _by_recording(results: RunResults) -> dict[str, list[MethodSummary]]:
    rows_of: dict[str, list[ResultRow]] = {one["name"]: [] for one in results.run["recordings"]}
    for row in results.rows:
        rows_of.setdefault(row.recording, []).append(row)
    return {name: summarize(rows, results.run["methods"]) for name, rows in rows_of.items()}


def results_json(results: RunResults) -> str:
    """Returns everything but the rows, which are in `rows.jsonl`."""
    document = {
        "protocol": results.protocol,
        "notes": results.notes,
        "methods": [dataclasses.asdict(summary) for summary in results.summaries],
        "by_recording": {
            name: [dataclasses.asdict(summary) for summary in summaries]
            for name, summaries in _by_recording(results).items()
        },
        "run": results.run,
    }
    return json.dumps(plain(document), indent=2, ensure_ascii=False, allow_nan=False) + "\n"


def _cell(value: float) -> str:
    return "" if math.isnan(value) else repr(value)


def _run_lines(run: Mapping[str, Any]) -> list[str]:
    session = run["sessions"][-1]
    versions = session["versions"]
    lines = [f"started {session['started']}"]
    if session["command"]:
        lines.append(f"command: `{' '.join(session['command'])}`")
    lines.append(f"machine: {_machine_text(session['machine'])}")
    lines.append("versions: " + ", ".join(f"{name} {value}" for name, value in versions.items()))
    lines.append(f"git commit: {session['git_commit'] or 'none, not a checkout'}")
    if len(run["sessions"]) > 1:
        lines.append(f"sessions: {len(run['sessions'])}, see run.json")
    return lines


def _machine_text(machine: Mapping[str, Any]) -> str:
    text = f"{machine['name']}, {machine['processor']}, {machine['cores']} cores"
    return f"{text}, {machine['gpu']}" if machine["gpu"] else text
