"""The report of a run: one HTML file that needs nothing else, neither network nor scripts."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Final

from mnsf_ros import __version__
from mnsf_ros.drawing.example_pictures import PicturedExample
from mnsf_ros.evaluation.results_files import RunResults
from mnsf_ros.evaluation.run_folder import replace_file
from mnsf_ros.report.figures_section import (
    bands_section,
    failures_section,
    more_tables,
    tables_section,
    tiles,
    times_section,
)
from mnsf_ros.report.html import Html, element, joined
from mnsf_ros.report.pictured import focus_method
from mnsf_ros.report.run_section import run_section
from mnsf_ros.report.style import STYLE
from mnsf_ros.report.worst_section import worst_section

REPORT_FILE: Final = "report.html"

# Nothing may be fetched, whatever the text of a recording's name or a failure says.
_POLICY: Final = "default-src 'none'; style-src 'unsafe-inline'; img-src data:; base-uri 'none'"


def write_report(
    results: RunResults,
    path: Path | str,
    *,
    pictured: Sequence[PicturedExample] = (),
    focus: str | None = None,
) -> None:
    """Writes the report; an earlier one is replaced as a whole or not at all.

    Args:
        results: All that the run gave.
        path: The file.
        pictured: Examples to show in pictures, the worst one first.
        focus: Method whose worst examples are listed; None for the paper's if it is there.

    Raises:
        WritingError: Writing fails.
    """
    focus = focus or focus_method(results.rows, results.record)
    text = report_html(results, pictured, focus)
    replace_file(Path(path), [text])


def report_html(results: RunResults, pictured: Sequence[PicturedExample], focus: str) -> str:
    """Returns the whole report.

    Args:
        results: All that a run gave.
        pictured: Examples to show in pictures, the worst one first.
        focus: Method whose worst examples are listed.
    """
    sections = [s for s in _sections(results, pictured, focus) if s[2]]
    title = _title(results)
    links = [element("a", name, href=f"#{key}") for key, name, _ in sections]
    of_focus = [summary for summary in results.summaries if summary.method == focus]
    head = element(
        "head",
        element("meta", charset="utf-8"),
        element("meta", http_equiv="Content-Security-Policy", content=_POLICY),
        element("meta", name_="viewport", content="width=device-width, initial-scale=1"),
        element("link", rel="icon", href="data:,"),
        element("title", title),
        element("style", Html(STYLE)),
    )
    header = element(
        "header",
        element(
            "div",
            element("h1", title),
            element("p", _subtitle(results, focus), class_="faint"),
            *(tiles(summary) for summary in of_focus),
            element("nav", *links, aria_label="Sections"),
        ),
    )
    body = [
        element("section", element("h2", name), content, id=key) for key, name, content in sections
    ]
    footer = element("footer", f"Written by mnsf_ros {__version__}. No scripts, no network.")
    page = element("body", header, element("main", *body), footer)
    return "<!DOCTYPE html>\n" + element("html", head, page, lang="en") + "\n"


def _sections(
    results: RunResults, pictured: Sequence[PicturedExample], focus: str
) -> list[tuple[str, str, Html]]:
    """Anchor, name and content; sections without content are not shown."""
    rows, summaries = results.rows, results.summaries
    if not rows:
        nothing = element("p", "There are no results yet.")
        return [
            ("results", "Results", nothing),
            ("run", "What was run", run_section(results.record)),
        ]
    protocol = joined(*(element("p", text) for text in results.protocol))
    notes = [element("li", note.text) for note in results.notes]
    return [
        ("results", "Results", joined(protocol, tables_section(results), failures_section(rows))),
        ("bands", "Where the errors are", bands_section(summaries)),
        ("time", "Where the time goes", times_section(rows, summaries)),
        ("worst", f"Worst examples of {focus}", worst_section(rows, focus, pictured)),
        ("more", "More figures", more_tables(results)),
        ("notes", "Notes", element("ul", *notes, class_="notes") if notes else Html()),
        ("run", "What was run", run_section(results.record)),
    ]


def _title(results: RunResults) -> str:
    names = [recording.name for recording in results.record.recordings]
    what = names[0] if len(names) == 1 else f"{len(names)} recordings"
    return f"Scene flow of {what}"


def _subtitle(results: RunResults, focus: str) -> str:
    methods = len(results.summaries)
    text = f"{methods} method{'' if methods == 1 else 's'}, {len(results.rows):,} estimates"
    return f"{text}. The large figures are those of {focus}." if focus else f"{text}."
