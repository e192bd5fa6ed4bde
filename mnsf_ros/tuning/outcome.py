# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""What a search has found: the settings that are worth changing, and what each of them gains."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from mnsf_ros.report.text_table import TextTable, format_number
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings
from mnsf_ros.settings_documents import settings_yaml
from mnsf_ros.tuning.judges import Judgement
from mnsf_ros.tuning.search import Search, Trier

PARAMETER_FILE: Final = "tuned.yaml"
PAGE: Final = "tuning.md"
# A parameter that gains less than this share of the cost keeps its value.
_WORTH: Final = 0.002


@dataclass(frozen=True)
class Gain:
    """What a changed parameter gains, alone on top of the settings to start from.

    Attributes:
        name: Full name.
        before: Its value before.
        after: Its value now.
        importance: Share of what decides between good and bad trials; NaN where they are too few.
        tuned: Cost saved on the half that was tuned.
        held_out: Cost saved on the other half.
    """

    name: str
    before: SettingValue
    after: SettingValue
    importance: float
    tuned: float
    held_out: float


@dataclass(frozen=True)
class Outcome:
    """What a search has found.

    Attributes:
        goal: What the cost is, with its unit.
        num_trials: Finished trials.
        gains: Of each changed parameter.
        tuned: Judgements on the half that was tuned, before and after.
        held_out: The same on the other half.
    """

    goal: str
    num_trials: int
    gains: list[Gain]
    tuned: tuple[Judgement, Judgement]
    held_out: tuple[Judgement, Judgement]

    @property
    def verdict(self) -> str:
        """One line on what it is worth."""
        if not self.gains:
            return (
                f"No change of a parameter gains anything in {self.num_trials} trials: keep the "
                "settings as they are; no parameter file is written."
            )
        before, after = (judgement.cost for judgement in self.held_out)
        words = f"{self.goal} of the half that was not tuned: {before:.4f} -> {after:.4f}"
        if after >= before:
            return f"{words}. Not better: keep the settings as they are."
        return f"{words}, {1 - after / before:.1%} less."


@dataclass(frozen=True, eq=False)
class Found:
    """A search that is over.

    Attributes:
        search: The trials.
        start: The settings that it started from.
        goal: What the cost is, with its unit.
        tuned: Tries settings on the half that was tuned.
        held_out: Tries settings on the other half.
    """

    search: Search
    start: Settings
    goal: str
    tuned: Trier
    held_out: Trier

    @property
    def changed(self) -> dict[str, SettingValue]:
        """What the best trial changes."""
        best = self.search.best_values.items()
        return {name: value for name, value in best if value != self.start.value_of(name)}


def write_best(found: Found, folder: Path, command: str) -> None:
    """Writes the parameter file of the best trial, which nobody has measured further yet.

    Raises:
        OSError: Writing fails.
    """
    title = (
        f"Written by `{command}`. Best of {len(found.search.trials)} trials; not judged on the "
        "other half yet."
    )
    _write_parameters(found.start, found.changed, folder, title)


def concluded(found: Found, watch: Callable[[int, int], None]) -> Outcome:
    """Gives back each change that gains nothing, and measures what the others gain.

    `watch` gets how many settings are tried, and how many there will be at most.
    """
    search, start, changed = found.search, found.start, found.changed
    num_done, num_in_all = 0, 4 + 3 * len(changed)

    def counted(trier: Trier) -> Trier:
        def tried(settings: Settings) -> Judgement:
            nonlocal num_done
            judgement = trier(settings)
            num_done += 1
            watch(num_done, num_in_all)
            return judgement

        return tried

    tuned, held_out = counted(found.tuned), counted(found.held_out)
    importances = search.importances
    before = tuned(start)
    after = tuned(start.changed(changed))
    for name in sorted(changed, key=lambda name: importances[name]):
        fewer = {other: value for other, value in changed.items() if other != name}
        judgement = tuned(start.changed(fewer))
        if judgement.cost <= after.cost * (1 + _WORTH):
            changed, after = fewer, judgement
            num_in_all -= 2
    before_held_out = held_out(start)
    gains = [
        Gain(
            name,
            start.value_of(name),
            value,
            importances[name],
            before.cost - tuned(start.changed({name: value})).cost,
            before_held_out.cost - held_out(start.changed({name: value})).cost,
        )
        for name, value in changed.items()
    ]
    both = before_held_out, held_out(start.changed(changed))
    return Outcome(found.goal, len(search.trials), gains, (before, after), both)


def gains_table(outcome: Outcome) -> TextTable:
    """Returns what each parameter gains."""
    header = ("parameter", "before", "after", "importance", "gain alone, tuned half", "other half")
    rows = [
        (
            gain.name,
            f"{gain.before}",
            f"{gain.after}",
            format_number(gain.importance, 2),
            f"{gain.tuned:+.4f}",
            f"{gain.held_out:+.4f}",
        )
        for gain in sorted(outcome.gains, key=lambda gain: -gain.tuned)
    ]
    return TextTable(header, rows, f"What each change gains alone: {outcome.goal} saved")


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


def write_outcome(outcome: Outcome, start: Settings, folder: Path, command: str) -> list[Path]:
    """Writes the page, and the parameter file if anything is to be changed; returns their paths.

    Raises:
        OSError: Writing fails.
    """
    page = folder / PAGE
    parts = ["# Tuning", outcome.verdict, f"Command: `{command}`"]
    parts += [table.markdown() for table in (figures_table(outcome), gains_table(outcome))]
    page.write_text("\n\n".join(parts), encoding="utf-8")
    values = {gain.name: gain.after for gain in outcome.gains}
    title = f"Written by `{command}`. {outcome.verdict}"
    return [page, *_write_parameters(start, values, folder, title)]


def _write_parameters(
    start: Settings, values: dict[str, SettingValue], folder: Path, title: str
) -> list[Path]:
    """Writes the parameter file, or removes an older one where nothing changes."""
    path = folder / PARAMETER_FILE
    if not values:
        path.unlink(missing_ok=True)
        return []
    path.write_text(settings_yaml(start.changed(values), title, values), encoding="utf-8")
    return [path]
