# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The tables of `paper_table.py`: for the terminal, and as a section of docs/performance.md."""

from __future__ import annotations

import math
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import replace

from kitti_examples import SCALES
from paper_figures import (
    ACC5,
    AUTHORS,
    DECIMALS,
    DYNAMIC,
    EPE,
    STATIC,
    Measured,
    measured_of,
    verdict,
)

from mnsf_ros.evaluation.metrics import FlowErrors
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.run_record import MachineRecord, SessionRecord
from mnsf_ros.report.tables import errors_table
from mnsf_ros.report.text_table import TextTable, format_number

_TABLES: Mapping[str, str] = {
    "Methods": "zero ego ego-estimated nsfp nsfp-linear fnsf fnsf-linear fnsf-joint fnsf-time"
    " mnsf-cycle mnsf authors/mnsf online online/online",
    "Ablations": "fnsf mnsf-no-backward mnsf+fusion.kind=mean mnsf+fusion.inversion=false mnsf",
    "Fusion operation": "mnsf+fusion.kind=mean mnsf+fusion.kind=weighted_sum mnsf+fusion.kind=mlp",
    "Fusion depth": " ".join(f"mnsf+fusion.num_hidden_layers={depth}" for depth in (2, 3, 5, 7)),
    "Sweeps": "mnsf-no-backward mnsf mnsf-frames4 mnsf-frames5",
}
_POINTS = {"8192": "8,192 points", "full": "full sweeps"}


def document(
    rows: Sequence[ResultRow],
    sessions: Sequence[SessionRecord],
    missing: Sequence[str],
    outdated: Sequence[str] = (),
) -> str:
    """Returns the section of the Markdown file.

    Args:
        rows: All result rows.
        sessions: The records of the runs that computed them.
        missing: What was planned and is not there.
        outdated: Methods whose settings have changed since, and which settings.
    """
    parts = [_provenance(sessions)]
    failures = [f"{row.method}, {row.recording}: {row.failure}" for row in rows if row.failure]
    if failures:
        parts.append("Gave no flow:\n\n" + "".join(f"* {text}\n" for text in failures))
    if missing:
        rest = "".join(f"* {text}\n" for text in missing)
        parts.append(f"Not computed yet; `make benchmark` continues there:\n\n{rest}")
    if outdated:
        lines = "".join(f"* {text}\n" for text in outdated)
        parts.append(
            "Computed with settings that have changed since; `make benchmark "
            f"BENCHMARK_OPTIONS='--again METHOD'` computes a method again:\n\n{lines}"
        )
    beside = _beside_the_authors(rows)
    if beside.rows:
        parts += ["### Beside the authors' own code\n", beside.markdown()]
    for title, table in tables(rows):
        parts += [f"### {title}\n", table.markdown()]
    return "\n".join(parts)


def printed(rows: Sequence[ResultRow]) -> list[TextTable]:
    """All tables for the terminal, with their titles."""
    named = [("Beside the authors' own code", _beside_the_authors(rows)), *tables(rows)]
    return [replace(table, title=title) for title, table in named if table.rows]


def tables(rows: Sequence[ResultRow]) -> list[tuple[str, TextTable]]:
    """Title and table of all that is there."""
    found = []
    for scale in SCALES:
        for title, methods in _TABLES.items():
            summaries = {name: measured_of(rows, scale, name) for name in methods.split()}
            known = {name: item for name, item in summaries.items() if item}
            if known:
                found.append((f"{title}, {_POINTS[scale]}", _errors(known)))
    return found


def _errors(summaries: Mapping[str, Measured]) -> TextTable:
    plain = errors_table(
        {name: item.errors["all"] for name, item in summaries.items()},
        times_ms={name: item.time_ms for name, item in summaries.items()},
    )
    header = [*plain.header, "EPE dynamic", "EPE static", "seeds"]
    rows = [
        [
            *row,
            format_number(item.errors["dynamic"].epe_m, 3),
            format_number(item.errors["static"].epe_m, 3),
            str(item.num_seeds),
        ]
        for row, item in zip(plain.rows, summaries.values(), strict=True)
    ]
    return TextTable(header, rows)


def _beside_the_authors(rows: Sequence[ResultRow]) -> TextTable:
    lines = []
    for method, authors in AUTHORS.items():
        measured = measured_of(rows, "8192", method)
        if measured is None:
            continue
        of_seeds = [_columns(*parts) for parts in zip(*measured.of_seeds.values(), strict=True)]
        ours = _columns(*measured.errors.values())
        spreads = {column: _deviation([seed[column] for seed in of_seeds]) for column in ours}
        cells = [_with_spread(ours[name], spreads[name], DECIMALS[name]) for name in ours]
        lines.append([method, *cells, verdict(authors, ours, spreads)])
        theirs = [f"{authors[name]:.{DECIMALS[name]}f}" for name in ours]
        lines.append([f"authors' {method.upper()}", *theirs, ""])
    return TextTable(("8,192 points", *DECIMALS, "verdict"), lines)


def _columns(over_all: FlowErrors, dynamic: FlowErrors, static: FlowErrors) -> dict[str, float]:
    return {
        EPE: over_all.epe_m,
        ACC5: 100.0 * over_all.acc5,
        DYNAMIC: dynamic.epe_m,
        STATIC: static.epe_m,
    }


def _with_spread(value: float, spread: float, decimals: int) -> str:
    text = f"{value:.{decimals}f}"
    return text if math.isnan(spread) else f"{text} ± {spread:.{decimals}f}"


def _deviation(values: Sequence[float]) -> float:
    return statistics.stdev(values) if len(values) > 1 else math.nan


def _provenance(sessions: Sequence[SessionRecord]) -> str:
    facts = {
        "Machine": [_machine(session.machine) for session in sessions],
        "Threads": [
            "1, at low priority beside other work: times are rough. They are those of the core; "
            "of the rows of the first sessions those of the clock"
        ],
        "Versions": [
            ", ".join(f"{name} {number}" for name, number in session.versions.items())
            for session in sessions
        ],
        "Commit": [_commit(session.git_commit) for session in sessions],
        "Started": [session.started[:10] for session in sessions],
    }
    # Most runs of a folder are alike.
    return "".join(f"* {key}: {'; '.join(dict.fromkeys(texts))}\n" for key, texts in facts.items())


def _machine(machine: MachineRecord) -> str:
    gpu, cores = machine.gpu or "no GPU", f"{machine.cores} cores"
    return f"{machine.name}: {machine.processor}, {cores}, {gpu}, {machine.system}"


def _commit(commit: str | None) -> str:
    name = commit or "unknown"
    return name[:12] + (" and changes" if "+changes" in name else "")
