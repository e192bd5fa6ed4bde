"""The report at the end of `mnsf evaluate`."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

from rich.console import Console

from mnsf_ros.errors import MnsfError
from mnsf_ros.evaluation.options import EvaluatedRecording
from mnsf_ros.evaluation.path_text import path_text
from mnsf_ros.evaluation.results_files import RunResults
from mnsf_ros.evaluation.run_folder import RunFolder

_PICTURES_LIMIT_S: Final = 60.0


def write_run_report(
    results: RunResults,
    folder: RunFolder,
    recordings: Sequence[EvaluatedRecording],
    num_pictured: int,
    console: Console,
    *,
    estimate_again: bool,
) -> bool:
    """Writes the report and says where it is. What goes wrong is said and costs no results.

    Args:
        results: All that the run gave.
        folder: Its folder.
        recordings: The recordings of the run.
        num_pictured: So many of the worst examples get pictures.
        console: Where to print.
        estimate_again: Whether to estimate these once more, for a minute at most, where the run
            wrote no flow.

    Returns:
        Whether there is a report.
    """
    from mnsf_ros.report.run_report import report_run

    def say(text: str) -> None:
        console.print(text, markup=False, highlight=False)

    try:
        path = report_run(
            results,
            folder.path,
            num_pictured=max(0, num_pictured),
            estimate_again=estimate_again,
            limit_s=_PICTURES_LIMIT_S,
            recordings=recordings,
            say=say,
        )
    except Exception as error:  # noqa: BLE001 - the results are there, whatever a picture costs
        reason = str(error) if isinstance(error, MnsfError) else repr(error)
        text = f"no report: {reason}; `mnsf report {path_text(folder.path)}` tries again"
        console.print(text, markup=False, highlight=False, style="yellow")
        return False
    say(f"Report: {path_text(path)}")
    return True
