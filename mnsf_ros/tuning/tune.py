# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tuning from recordings to the settings that are worth changing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.settings import Settings
from mnsf_ros.tuning.halves import Half, read_halves
from mnsf_ros.tuning.judges import LABELLED_GOALS, Judge, LabelledJudge
from mnsf_ros.tuning.outcome import Found
from mnsf_ros.tuning.search import Budget, Search, tuned_settings
from mnsf_ros.tuning.self_consistency import ConsistencyJudge

TRIALS_FILE: Final = "trials.log"
CONSISTENCY: Final = "consistency"
GOALS: Final = (*LABELLED_GOALS, CONSISTENCY)


@dataclass(frozen=True)
class TuneOptions:
    """How to tune.

    Attributes:
        out: Folder for the trials.
        start: Settings to start from; those set explicitly are not tuned.
        budget: When the search ends.
        names: Full names of the settings to tune; if empty, all that are declared so.
        goal: One of `GOALS`; None for the usual one of the recordings.
        max_examples: Of each half of a recording.
        seed: Of the search and of the points that are looked at.
        resume: Whether to go on with the trials in the folder.
    """

    out: Path
    start: Settings
    budget: Budget
    names: tuple[str, ...] = ()
    goal: str | None = None
    max_examples: int = 40
    seed: int = 0
    resume: bool = False

    def __post_init__(self) -> None:
        if self.max_examples < 1:
            raise EvaluationError(f"max-examples: got {self.max_examples}, expected 1 or more")


def search_settings(
    recordings: Sequence[EvaluatedRecording],
    options: TuneOptions,
    watch: Callable[[int, float], None],
) -> Found:
    """Searches on the first halves of recordings; see `concluded` for what is next.

    `watch` gets the number of finished trials and the lowest cost.

    Raises:
        MnsfError: Something that was given cannot be used.
    """
    evaluation = EvaluationOptions(options.start, seed=options.seed)
    settings = tuned_settings(options.names, options.start.explicit)
    goal = _goal(options.goal, recordings)
    path = options.out / TRIALS_FILE
    if path.exists() and not options.resume:
        raise EvaluationError(
            f"{options.out}: exists already; name another folder, or add --resume"
        )
    search = Search(path, settings, evaluation.settings, options.seed)
    search.check_identity(
        {
            **evaluation.settings.to_mapping(),
            "goal": goal,
            "parameters": [one.name for one in settings],
            "max-examples": options.max_examples,
            **{one.name: one.identity for one in recordings},
        }
    )
    halves = read_halves(recordings, evaluation, options.max_examples)
    first, second = (_judge(goal, half, evaluation.settings, options.seed) for half in halves)
    # Nothing is estimated twice with the same settings.
    tried = cache(first)
    search.run(tried, options.budget, watch)
    return Found(search, evaluation.settings, first.goal, tried, cache(second))


def _goal(wanted: str | None, recordings: Sequence[EvaluatedRecording]) -> str:
    unlabelled = [one.name for one in recordings if one.truth is None]
    if wanted is None:
        return CONSISTENCY if unlabelled else "epe"
    if unlabelled and wanted in LABELLED_GOALS:
        raise EvaluationError(
            f"--goal {wanted} needs true flow, which {', '.join(unlabelled)} has not; use --goal "
            f"{CONSISTENCY}"
        )
    return wanted


def _judge(goal: str, half: Half, settings: Settings, seed: int) -> Judge:
    if goal == CONSISTENCY:
        return ConsistencyJudge(half, settings, seed)
    return LabelledJudge(half, goal)
