# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's ablation tables: variants of the method, scored on the same examples."""

from collections.abc import Sequence
from typing import Final

import pandas as pd

from mnsf_ros.evaluation.metrics import ERRORS
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.summary import errors_in
from mnsf_ros.report.tables import errors_table
from mnsf_ros.studies.study import StudyOptions, StudyResult, texts_on

_GROUPS: Final = {"all": "all points", "dynamic": "dynamic points", "static": "static points"}

# Title of the table, and name of each row to its method.
_Study = tuple[str, dict[str, str]]
_STUDIES: Final[dict[str, _Study]] = {
    "ablation": (
        "Ablation: contribution of each part of the method",
        {
            "FNSF": "fnsf",
            "(a) without the backward flow": "mnsf-no-backward",
            "(b) inversion and mean, no fusion network": "mnsf+fusion.kind=mean",
            "(c) without inversion": "mnsf+fusion.inversion=false",
            "(d) MNSF": "mnsf",
        },
    ),
    "fusion": (
        "Fusion operation",
        {
            "FNSF": "fnsf",
            "mean": "mnsf+fusion.kind=mean",
            "weighted sum": "mnsf+fusion.kind=weighted_sum",
            "MLP": "mnsf+fusion.kind=mlp",
        },
    ),
    "depth": (
        "Depth of the fusion network",
        {f"{depth} layers": f"mnsf+fusion.num_hidden_layers={depth}" for depth in (2, 3, 5, 7)},
    ),
    "frames": (
        "Number of sweeps",
        {
            "2 sweeps": "mnsf-no-backward",
            "3 sweeps": "mnsf",
            "4 sweeps": "mnsf-frames4",
            "5 sweeps": "mnsf-frames5",
        },
    ),
}


def run(name: str, options: StudyOptions) -> StudyResult:
    """Evaluates the variants; `evaluation` in the folder is an evaluation like any other.

    Raises:
        MnsfError: A recording or a setting cannot be used, or no example can be scored.
        OSError: Writing fails.
    """
    _, variants = _STUDIES[name]
    results = options.evaluated(variants.values(), options.evaluation, options.recordings)
    return _result(_STUDIES[name], results.summary, texts_on(results), results.record.options)


def _result(
    study: _Study, summary: pd.DataFrame, texts: Sequence[str], evaluation: EvaluationOptions
) -> StudyResult:
    study_title, variants = study
    known = {name: m for name, m in variants.items() if m in summary.index}
    named = summary.loc[list(known.values())].set_axis(list(known))
    errors = {group: errors_in(named, group).reindex(columns=ERRORS) for group in _GROUPS}
    errors = {group: table for group, table in errors.items() if table["num_points"].any()}
    tables, numbers = [], []
    for group, table in errors.items():
        times = named[["time_ms"] if group == "all" else []]
        title = f"{study_title}, {_GROUPS[group]}"
        tables.append(errors_table(table.join(times), title, "variant"))
        numbers.append(table.astype({"num_points": int}).join(named["time_ms"]))
        numbers[-1].insert(0, "points", group)
        numbers[-1].insert(0, "method", pd.Series(known))
    rows = pd.concat(numbers).rename_axis("variant").reset_index()
    return StudyResult(study_title, texts, tables, rows, evaluation)
