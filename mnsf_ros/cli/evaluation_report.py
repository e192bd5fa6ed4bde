"""The end of `mnsf evaluate`: results as files, tables on the terminal, and the report."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich.console import Console

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.options import EvaluatedRecording
from mnsf_ros.evaluation.results_files import RunResults, read_results, write_results
from mnsf_ros.evaluation.run_folder import RunFolder
from mnsf_ros.evaluation.run_record import path_text
from mnsf_ros.evaluation.tables import main_tables, work_table

_PICTURES_LIMIT_S: Final = 60.0


def conclude(
    folder: RunFolder,
    recordings: Sequence[EvaluatedRecording],
    num_pictured: int,
    console: Console,
    *,
    estimate_again: bool,
) -> bool:
    """Writes and prints what the run gave so far; removes the folder of a run that gave nothing.

    Args:
        folder: The run.
        recordings: The recordings of the run.
        num_pictured: So many of the worst examples get pictures.
        console: Where to print.
        estimate_again: Whether to estimate these again, for a minute at most, where the run
            wrote no flow.

    Returns:
        Whether the results are complete and there is a report.

    Raises:
        WritingError: Results cannot be written.
    """
    if folder.remove_if_unused():
        return False
    results = read_results(folder)
    write_results(folder, results)
    _print_results(results, folder, console)
    is_reported = _write_report(
        results, folder, recordings, max(0, num_pictured), console, estimate_again
    )
    return is_reported and not results.is_incomplete


def say(console: Console, text: str) -> None:
    """Prints a text as it is, whatever it holds."""
    console.print(text, markup=False, highlight=False)


def warn(console: Console, text: str) -> None:
    """Prints a text that needs attention."""
    console.print(text, markup=False, highlight=False, style="yellow")


def _print_results(results: RunResults, folder: RunFolder, console: Console) -> None:
    if not results.summaries:
        for text in ("No results.", *map(str, results.notes)):
            warn(console, text)
        return
    for table in [*main_tables(results.summaries), work_table(results.summaries)]:
        console.print(table.rich())
    for text in results.protocol:
        say(console, text)
    for note in results.notes:
        (warn if note.kind.is_incomplete else say)(console, note.text)
    say(console, f"Results: {path_text(folder.path / 'results.md')}")


def _write_report(
    results: RunResults,
    folder: RunFolder,
    recordings: Sequence[EvaluatedRecording],
    num_pictured: int,
    console: Console,
    estimate_again: bool,
) -> bool:
    """Returns whether there is a report; what goes wrong costs no results."""
    from mnsf_ros.report.run_report import report_run

    try:
        path = report_run(
            results,
            folder.path,
            num_pictured=num_pictured,
            estimate_again=estimate_again,
            limit_s=_PICTURES_LIMIT_S,
            recordings=recordings,
            say=lambda text: say(console, text),
        )
    except Exception as error:  # noqa: BLE001 - the results are there, whatever a picture costs
        reason = str(error) if isinstance(error, MnsfError) else repr(error)
        warn(console, f"no report: {reason}; `mnsf report {path_text(folder.path)}` tries again")
        return False
    say(console, f"Report: {path_text(path)}")
    return True
