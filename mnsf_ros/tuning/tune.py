# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tuning: settings are searched on the first halves of recordings and judged on the second."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

from mnsf_ros.errors import EvaluationError, SettingsError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.settings import Settings
from mnsf_ros.tuning.halves import read_halves
from mnsf_ros.tuning.judges import LABELLED_GOALS, Judgement, LabelledJudge
from mnsf_ros.tuning.outcome import Outcome
from mnsf_ros.tuning.search import Values, num_done, open_study, run_trials, tuned_settings
from mnsf_ros.tuning.self_consistency import ConsistencyJudge

CONSISTENCY: Final = "consistency"
# A change that saves less than this share of the cost is taken back.
_WORTH: Final = 0.002

# Gets a text, the number of steps done, and their number in all.
Watch = Callable[[str, int, int], None]


@dataclass(frozen=True)
class TuneOptions:
    """How to tune.

    Attributes:
        out: Folder of the trials.
        start: Settings to start from; those set explicitly are not tuned.
        num_trials: Number of trials in all.
        minutes: Time limit of the search.
        names: Full names of the settings to tune; if empty, all that are declared so.
        goal: One of `LABELLED_GOALS` or `CONSISTENCY`; None for the default of the recordings.
        max_examples: Maximum number of examples of each half of a recording.
        seed: Of the search and of the points that are scored.
        resume: Whether to continue with the trials in the folder.

    Raises:
        SettingsError: If a number is out of its range.
    """

    out: Path
    start: Settings
    num_trials: int = 60
    minutes: float = math.inf
    names: tuple[str, ...] = ()
    goal: str | None = None
    max_examples: int = 40
    seed: int = 0
    resume: bool = False

    def __post_init__(self) -> None:
        for option, value in (
            ("trials", self.num_trials),
            ("minutes", self.minutes),
            ("max-examples", self.max_examples),
        ):
            if not value > 0:
                raise SettingsError(f"{option}: got {value:g}, expected more than 0")


def tune(recordings: Sequence[EvaluatedRecording], options: TuneOptions, watch: Watch) -> Outcome:
    """Searches for better settings and judges them on the halves that were not tuned.

    Raises:
        MnsfError: An option or a recording cannot be used, or the folder has another search.
    """
    evaluation = EvaluationOptions(options.start, seed=options.seed)
    start, goal = evaluation.settings, _goal(options.goal, recordings)
    names = [one.name for one in tuned_settings(options.names, options.start.explicit)]
    identity = {
        **start.to_mapping(),
        "goal": goal,
        "parameters": names,
        "max-examples": options.max_examples,
        **{one.name: one.identity for one in recordings},
    }
    study = open_study(options.out, identity, options.seed, resume=options.resume)
    tuned, held_out = (
        ConsistencyJudge(half, start, options.seed)
        if goal == CONSISTENCY
        else LabelledJudge(half, goal)
        for half in read_halves(recordings, evaluation, options.max_examples)
    )

    def say(number: int, lowest: float) -> None:
        watch(f"trials, lowest cost {lowest:.4f}", number, options.num_trials)

    before = {name: start.value_of(name) for name in names}
    best = run_trials(
        study,
        before,
        options.num_trials,
        None if math.isinf(options.minutes) else 60.0 * options.minutes,
        lambda values: tuned(start.changed(values)).cost,
        say,
    )
    changed = {name: value for name, value in best.items() if value != before[name]}
    num_judged, num_in_all = 0, 4 + len(changed)

    def judged(judge: Callable[[Settings], Judgement], values: Values) -> Judgement:
        nonlocal num_judged
        watch("judging each change, and on the other half", num_judged, num_in_all)
        num_judged += 1
        return judge(start.changed(values))

    kept, gains, on_tuned = _worthwhile(changed, partial(judged, tuned))
    on_other = judged(held_out, {}), judged(held_out, kept)
    return Outcome(start, tuned.goal, num_done(study), kept, gains, on_tuned, on_other)


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


def _worthwhile(
    changed: Values, judged: Callable[[Values], Judgement]
) -> tuple[Values, dict[str, float], tuple[Judgement, Judgement]]:
    """Takes back each change that gains nothing.

    Returns:
        The changes that are left, the cost that each saves, and the judgements without and with
        them.
    """
    before, after = judged({}), judged(changed)
    gains = {}
    for name in tuple(changed):
        others = {other: value for other, value in changed.items() if other != name}
        without = judged(others)
        if without.cost <= after.cost * (1 + _WORTH):
            changed, after = others, without
        else:
            gains[name] = without.cost - after.cost
    return changed, gains, (before, after)
