# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Result of a search: the changes that are worth it, judged on the half that was not tuned."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mnsf_ros.report.text_table import TextTable, format_number
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_yaml
from mnsf_ros.tuning.judges import Judgement

PARAMETER_FILE: Final = "tuned.yaml"


@dataclass(frozen=True)
class Outcome:
    """Result of a search.

    Attributes:
        start: The settings at its start.
        goal: Name and unit of the cost.
        num_trials: Number of trials.
        changed: Full name to the new value of each changed parameter.
        tuned: Judgements on the half that was tuned, before and after.
        held_out: The same on the other half.
    """

    start: Settings
    goal: str
    num_trials: int
    changed: dict[str, SettingValue]
    tuned: tuple[Judgement, Judgement]
    held_out: tuple[Judgement, Judgement]

    @property
    def changes(self) -> list[str]:
        """One line for each changed parameter, with the values before and after."""
        items = self.changed.items()
        return [f"{name}: {self.start.value_of(name)} -> {value}" for name, value in items]

    @property
    def verdict(self) -> str:
        """One line on whether the changes help."""
        if not self.changed:
            return (
                f"No change of a parameter gains anything in {self.num_trials} trials: keep the "
                "settings as they are; no parameter file is written."
            )
        before, after = (judgement.cost for judgement in self.held_out)
        words = f"{self.goal} of the half that was not tuned: {before:.4f} -> {after:.4f}"
        if after >= before:
            return f"{words}. Not better: keep the settings as they are."
        return f"{words}, {1 - after / before:.1%} less."


def figures_table(outcome: Outcome) -> TextTable:
    """Returns all figures, before and after, on both halves."""
    halves = (*outcome.tuned, *outcome.held_out)
    names = dict.fromkeys(name for one in halves for name in one.figures)
    rows = [
        (name, *(format_number(one.figures.get(name, math.nan), 4) for one in halves))
        for name in names
    ]
    header = ("figure", "tuned half, before", "after", "other half, before", "after")
    return TextTable(header, rows, "Before and after")


def write_parameters(outcome: Outcome, folder: Path, command: str) -> Path | None:
    """Writes the parameter file, if anything changes, and returns its path.

    Raises:
        OSError: Writing fails.
    """
    path = folder / PARAMETER_FILE
    if not outcome.changed:  # and none of an earlier search
        path.unlink(missing_ok=True)
        return None
    settings = outcome.start.changed(outcome.changed)
    title = f"Written by `{command}`. {outcome.verdict}"
    path.write_text(settings_yaml(settings, title, outcome.changed), encoding="utf-8")
    return path
