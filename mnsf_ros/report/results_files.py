# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The results of a run as files: Markdown, CSV and LaTeX."""

from collections.abc import Iterator
from typing import Final

import pandas as pd

from mnsf_ros.errors import plain_text
from mnsf_ros.evaluation.metrics import ERRORS
from mnsf_ros.evaluation.run_folder import RunFolder, replace_file
from mnsf_ros.evaluation.run_record import RunRecord, Session
from mnsf_ros.evaluation.summary import FAST, SLOW, groups_in
from mnsf_ros.report.run_results import RunResults
from mnsf_ros.report.tables import CALLED_DYNAMIC, TRACKED
from mnsf_ros.report.text_table import markdown_code, markdown_text

_COUNTS: Final = ("num_examples", "num_failed", "num_dropped")
# Columns of the file that hold the same value for all points, and their names in the summary.
_FIGURES: Final = {
    "time_ms": "time_ms",
    "latency_ms": "latency_ms",
    "nearest_m": "consistency.nearest_m",
    "zero_nearest_m": "consistency.zero_nearest_m",
}
_MOVERS: Final = {name: f"movers.{name}" for name in (*CALLED_DYNAMIC, *TRACKED)} | {
    f"{kind}_{key}": f"movers.{group}.{key}"
    for kind, group in (("fast", FAST), ("slow", SLOW))
    for key in ("found", "flicker", "delay_s")
}
_LOST: Final = "num_lost"
# Facts of the sessions, by their names in the file.
_FACTS: Final = {
    "mnsf_ros_version": "mnsf_ros",
    "torch_version": "torch",
    "machine": "machine",
    "git_commit": "git commit",
}
# Groups of points: a prefix in the summary, and its name in the file.
_POINTS: Final = {"errors": "{}", "by_range": "range up to {} m", "by_speed": "speed up to {} m/s"}


def write_results(folder: RunFolder, results: RunResults) -> None:
    """Writes results.md, .csv and .tex.

    Raises:
        StoppedError: Writing fails; earlier files that are not replaced yet are still there.
    """
    replace_file(folder.path / "results.md", results_markdown(results))
    replace_file(folder.path / "results.csv", results_csv(results))
    replace_file(folder.path / "results.tex", _results_latex(results))


def results_markdown(results: RunResults) -> str:
    """Returns the protocol, all tables, the notes and the session."""
    parts = ["# Scene flow evaluation", *map(markdown_text, results.protocol)]
    tables = (*results.main_tables, *results.further_tables)
    parts += [table.markdown().rstrip("\n") for table in tables]
    if results.notes:
        parts += ["## Notes", "\n".join(f"* {markdown_text(note.text)}" for note in results.notes)]
    *earlier, last = results.record.sessions
    lines = session_lines(last)
    if earlier:
        lines.append(f"* sessions: {len(earlier) + 1}, see run.json")
    parts += ["## Run", "\n".join(lines)]
    return "\n\n".join(parts) + "\n"


def _results_latex(results: RunResults) -> str:
    head = ["% \\usepackage{booktabs}", *(f"% {text}" for text in results.protocol)]
    command = results.record.sessions[-1].get("command", "")
    tables = (*results.main_tables, *results.further_tables)
    return "\n".join([*head, f"% {command}", "", *(one.latex() for one in tables)])


def results_csv(results: RunResults) -> str:
    """Returns one line for each method and group of points: of all recordings, then of each.

    The column `recording` is empty for all recordings together. Settings, versions and machine are
    the same on every line of a method; the scores of movers, which come last but for the number of
    sweeps without ego motion, are for all points.
    """
    methods = dict.fromkeys((*results.record.method_names, *results.summary.index))
    origins = {name: _origin(results.record, name) for name in methods}
    lines = [
        {"recording": recording, "method": plain_text(method)}
        | line
        | origins[method]
        | {name: own.get(key) for name, key in _MOVERS.items()}
        | {_LOST: int(own[_LOST])}
        for recording, summary in {"": results.summary, **results.by_recording}.items()
        for method, own in summary.iterrows()
        for line in _lines(own)
    ]
    origin = next(iter(origins.values()), {})
    first = ("recording", "method", "points", *_COUNTS, *ERRORS, *_FIGURES)
    names = [*first, *origin, *_MOVERS, _LOST]
    # As objects: a missing value would turn the whole numbers of its column into floats.
    table = pd.DataFrame(lines, columns=names, dtype=object)
    return table.to_csv(index=False, lineterminator="\n")


def _lines(own: pd.Series) -> Iterator[dict[str, object]]:
    """Yields a line for each scored group of points; one without errors if there is none."""
    figures: dict[str, object] = {name: int(own[name]) for name in _COUNTS}
    figures |= {name: own.get(key) for name, key in _FIGURES.items()}
    has_errors = False
    for prefix, words in _POINTS.items():
        for name in groups_in(own, prefix):
            errors = {key: own[f"{prefix}.{name}.{key}"] for key in ERRORS}
            errors["num_points"] = int(errors["num_points"])
            yield {"points": words.format(name), **figures, **errors}
            has_errors = True
    if not has_errors:
        yield {"points": "", **figures}


def _origin(record: RunRecord, method: str) -> dict[str, object]:
    """Returns settings, versions and machine of a method, all of them where sessions differ."""
    options = record.options
    _, preset, changes = record.used_settings(method)
    return {
        "seed": options.seed,
        "preset": preset,
        "changed_settings": "; ".join(f"{key} = {value}" for key, value in changes.items()),
        "num_threads": options.settings.compute.num_threads,
        "points_given": options.num_points or "all",
        "ground": options.ground,
        "realtime_rate": options.realtime or "",
        "every": options.every,
    } | {
        column: "; ".join(dict.fromkeys(one.get(fact, "") for one in record.sessions))
        for column, fact in _FACTS.items()
    }


def session_lines(session: Session) -> list[str]:
    """Returns the facts of a session as lines of Markdown."""
    return [
        f"* {name}: {markdown_code(text) if name == 'command' else markdown_text(text)}"
        for name, text in session.items()
        if text
    ]
