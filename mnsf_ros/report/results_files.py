# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The results of a run as files: Markdown for people, CSV and JSON for programs."""

from __future__ import annotations

import csv
import dataclasses
import io
import math
from collections.abc import Iterable, Iterator
from typing import Final

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.mover_summary import FAST, SLOW
from mnsf_ros.evaluation.results import MethodSummary
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.evaluation.run_json import to_json
from mnsf_ros.evaluation.run_record import SessionRecord
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.run_tables import RunTables

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


def write_results(folder: RunFolder, results: RunResults, tables: RunTables) -> None:
    """Writes results.md, .csv, .tex and .json, in place of those of an earlier session.

    Raises:
        WritingError: Writing fails; files that are not written yet are those of before.
    """
    for name, text in (
        ("results.md", results_markdown(results, tables)),
        ("results.csv", results_csv(results)),
        ("results.tex", results_latex(results, tables)),
        ("results.json", results_json(results)),
    ):
        replace_file(folder.path / name, [text])


def results_markdown(results: RunResults, tables: RunTables) -> str:
    """Returns all tables with what they are tables of."""
    parts = ["# Scene flow evaluation", *results.protocol]
    parts += [table.markdown().rstrip("\n") for table in tables.listed]
    if results.notes:
        parts += ["## Notes", "\n".join(f"* {note}" for note in results.notes)]
    *earlier, last = results.record.sessions
    lines = session_lines(last)
    if earlier:
        lines.append(f"* sessions: {len(earlier) + 1}, see run.json")
    parts += ["## Run", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def results_latex(results: RunResults, tables: RunTables) -> str:
    """Returns all tables for LaTeX, with what they are tables of as comments."""
    head = ["% \\usepackage{booktabs}", *(f"% {text}" for text in results.protocol)]
    command = results.record.sessions[-1].command_line
    return "\n".join([*head, f"% {command}", "", *(one.latex() for one in tables.listed)])


def results_csv(results: RunResults) -> str:
    """Returns one line for each method and group of points: of all recordings, then of each.

    The column `recording` is empty for all recordings together. How, with what and where figures
    were made is the same on every line of a method; those of movers, which come last, are for all
    points.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    # What came later stands behind the rest, so that columns keep their places.
    added = [f"{kind}_{key}" for kind in _CSV_GROUPS for key in _CSV_GROUP]
    names = _origin(results, results.focus)
    writer.writerow(("recording", "method", "points", *_CSV_FIGURES, *names, *_CSV_MOVERS, *added))
    for recording, summaries in {"": results.summaries, **results.by_recording}.items():
        for summary in summaries:
            origin = _origin(results, summary.method)
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


def _origin(results: RunResults, method: str) -> dict[str, str]:
    """How, with what and where a method ran; what sessions do not agree on is listed."""
    options, sessions = results.record.options, results.record.sessions
    _, name, changes = results.used_settings[method]
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
    facts = session.facts | {"command": f"`{session.command_line}`"}
    return [f"* {name}: {text}" for name, text in facts.items() if text != "``"]
