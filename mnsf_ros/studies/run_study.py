# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Studies by name; each writes a page in Markdown, numbers as CSV, and a chart."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Final

from mnsf_ros.evaluation.run_folder import check_folder
from mnsf_ros.evaluation.run_record import session_now
from mnsf_ros.report.results_files import session_lines
from mnsf_ros.report.text_table import markdown_text
from mnsf_ros.studies.landscape_study import run_landscape_study
from mnsf_ros.studies.method_study import METHOD_STUDIES, run_method_study
from mnsf_ros.studies.stability_study import run_stability_study, stability_settings
from mnsf_ros.studies.study import StudyOptions, StudyResult

STUDIES: Final[dict[str, Callable[[StudyOptions], StudyResult]]] = {
    **{study.name: partial(run_method_study, study) for study in METHOD_STUDIES},
    "landscape": run_landscape_study,
    "stability": run_stability_study,
}


def run_study(name: str, options: StudyOptions) -> tuple[StudyResult, list[Path]]:
    """Runs one of `STUDIES`; returns its result and the files NAME.md, NAME.csv and NAME.png.

    Raises:
        MnsfError: An option, a setting, a recording or the folder cannot be used.
        OSError: Writing fails.
    """
    check_folder(options.out, resume=options.resume)
    if name == "stability":
        settings = stability_settings(options.evaluation.settings)
        options = replace(options, evaluation=replace(options.evaluation, settings=settings))
    result = STUDIES[name](options)
    options.out.mkdir(parents=True, exist_ok=True)
    paths = [options.out / f"{name}{suffix}" for suffix in (".md", ".csv", ".png")]
    paths[0].write_text(_page(name, result, options), encoding="utf-8")
    result.numbers.to_csv(paths[1], index=False, na_rep="nan", lineterminator="\n")
    paths[2].write_bytes(result.picture)
    return result, paths


def _page(name: str, result: StudyResult, options: StudyOptions) -> str:
    evaluation, number = options.evaluation, options.evaluation.num_points
    parts = [f"# {result.title}", *map(markdown_text, result.texts)]
    parts += [table.markdown().rstrip("\n") for table in result.tables]
    parts += [f"![{result.title}]({name}.png)", "## Run"]
    facts = {
        "seed": str(evaluation.seed),
        "points of a sweep": "all" if number is None else f"{number:,}",
        "recordings": ", ".join(map(str, options.recordings)) or "a simulated street",
    }
    lines = [f"* {fact}: {markdown_text(text)}" for fact, text in facts.items()]
    parts.append("\n".join([*session_lines(session_now(options.command)), *lines]))
    settings = evaluation.settings.to_mapping()
    lines = [f"| {setting} | {value} |" for setting, value in settings.items()]
    parts.append("\n".join(["| setting | value |", "| :--- | ---: |", *lines]))
    return "\n\n".join(parts) + "\n"
