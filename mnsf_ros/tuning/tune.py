# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tuning: Optuna searches settings on the first halves of recordings, the second halves judge.

Optuna's journal of trials is the state from which a search is resumed.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import count
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import EvaluationError, SettingsError, library_missing, one_line
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import Settings, declared_setting, declared_settings
from mnsf_ros.tuning.judges import Judgement, LabelledJudge, read_halves
from mnsf_ros.tuning.outcome import Outcome
from mnsf_ros.tuning.self_consistency import ConsistencyJudge

if TYPE_CHECKING:
    import optuna

EPE: Final = "epe"
CONSISTENCY: Final = "consistency"
# A change that saves less than this share of the cost is taken back.
_WORTH: Final = 0.002

TRIALS_FILE: Final = "trials.log"
_IDENTITY: Final = "identity"
_STEP: Final = 0.01
# In place of infinity, which the sampler cannot compare.
_WORST: Final = 1e6

Values = dict[str, SettingValue]
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
        goal: `EPE` or `CONSISTENCY`; None for the default of the recordings.
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
        options = ("trials", "minutes", "max-examples")
        values = self.num_trials, self.minutes, self.max_examples
        for option, value in zip(options, values, strict=True):
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
    study = _open_study(options.out, identity, options.seed, resume=options.resume)
    tuned, held_out = (
        ConsistencyJudge(half, start, options.seed) if goal == CONSISTENCY else LabelledJudge(half)
        for half in read_halves(recordings, evaluation, options.max_examples)
    )

    before = {name: start.value_of(name) for name in names}
    best = _best_values(study, before, options, watch, lambda v: tuned(start.changed(v)).cost)
    changed = {name: value for name, value in best.items() if value != before[name]}
    numbers, num_in_all = count(), 4 + len(changed)

    def judged(judge: Callable[[Settings], Judgement], values: Values) -> Judgement:
        watch("judging each change, and on the other half", next(numbers), num_in_all)
        return judge(start.changed(values))

    kept, on_tuned = _worthwhile(changed, partial(judged, tuned))
    on_other = judged(held_out, {}), judged(held_out, kept)
    return Outcome(start, tuned.goal, _num_done(study), kept, on_tuned, on_other)


def _goal(wanted: str | None, recordings: Sequence[EvaluatedRecording]) -> str:
    unlabelled = [one.name for one in recordings if one.truth is None]
    if wanted is None:
        return CONSISTENCY if unlabelled else EPE
    if unlabelled and wanted == EPE:
        raise EvaluationError(
            f"--goal {wanted} needs true flow, which {', '.join(unlabelled)} has not; use --goal "
            f"{CONSISTENCY}"
        )
    return wanted


def _worthwhile(
    changed: Values, judged: Callable[[Values], Judgement]
) -> tuple[Values, tuple[Judgement, Judgement]]:
    """Takes back each change that gains nothing; returns the others and both judgements."""
    before, after = judged({}), judged(changed)
    for name in tuple(changed):
        others = {other: value for other, value in changed.items() if other != name}
        without = judged(others)
        if without.cost <= after.cost * (1 + _WORTH):
            changed, after = others, without
    return changed, (before, after)


def tuned_settings(names: Sequence[str] = (), fixed: frozenset[str] = frozenset()) -> list[Setting]:
    """Returns the settings to tune: those named, or all that are declared so but the fixed ones.

    Raises:
        SettingsError: A setting is unknown or cannot be tuned, or none is left.
    """
    able = {one.name: one for one in declared_settings() if one.tuned is not None}
    for name in names:
        if declared_setting(name).name not in able:
            raise SettingsError(f"{name}: cannot be tuned; choose from {', '.join(able)}")
    chosen = [able[name] for name in names or able if name not in fixed]
    if not chosen:
        raise SettingsError("no parameter is left to tune: --set fixes those that it names")
    return chosen


def check_optuna() -> None:
    """Checks that the library of the search is there.

    Raises:
        SettingsError: It is not installed.
    """
    try:
        import optuna
    except ModuleNotFoundError as error:
        raise SettingsError(library_missing(error)) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)


def _open_study(
    folder: Path, identity: Mapping[str, object], seed: int, *, resume: bool
) -> optuna.Study:
    """Opens the trials in a folder, which is made if it is not there.

    Raises:
        EvaluationError: The trials are damaged, or `resume` is false, or they are of a search with
            another identity: recordings, settings and options on which costs depend.
    """
    import optuna
    from optuna.storages.journal import JournalFileBackend

    path = folder / TRIALS_FILE
    if path.exists() and not resume:
        raise EvaluationError(f"{folder}: exists already; name another folder, or add --resume")
    if path.exists() and not path.is_file():
        raise EvaluationError(f"{path}: is not a file")
    folder.mkdir(parents=True, exist_ok=True)
    try:
        storage = optuna.storages.JournalStorage(JournalFileBackend(str(path)))
        study = optuna.create_study(storage=storage, study_name="tune", load_if_exists=True)
    except Exception as error:  # as the lines of a damaged file have it
        raise EvaluationError(f"{path}: cannot be read: {one_line(error)}") from error
    study.sampler = optuna.samplers.TPESampler(seed=seed + len(study.trials))
    texts = {name: str(value) for name, value in identity.items()}
    known = study.user_attrs.get(_IDENTITY, texts)
    others = [name for name, text in texts.items() if known.get(name) != text]
    if others:
        raise EvaluationError(
            f"cannot continue: {', '.join(others)} differ from those of the search in the "
            "folder; name another folder"
        )
    study.set_user_attr(_IDENTITY, texts)
    return study


def _best_values(
    study: optuna.Study,
    start: Values,
    options: TuneOptions,
    watch: Watch,
    cost_of: Callable[[Values], float],
) -> Values:
    """Runs the trials that are left, the first one with the values `start`."""
    settings = [declared_setting(name) for name in start]

    def tried(trial: optuna.Trial) -> float:
        return min(cost_of({one.name: _suggested(trial, one) for one in settings}), _WORST)

    def say(study: optuna.Study, _: object) -> None:
        text = f"trials, lowest cost {study.best_value:.4f}"
        watch(text, _num_done(study), options.num_trials)

    if not _num_done(study):
        study.enqueue_trial(dict(start))
    timeout_s = None if math.isinf(options.minutes) else 60.0 * options.minutes
    if (num_left := options.num_trials - _num_done(study)) > 0:
        study.optimize(tried, num_left, timeout_s, callbacks=[say])
    return {one.name: one.checked(_rounded(study.best_params[one.name])) for one in settings}


def _num_done(study: optuna.Study) -> int:
    """Returns the number of finished trials."""
    return sum(trial.value is not None for trial in study.get_trials(deepcopy=False))


def _suggested(trial: optuna.Trial, setting: Setting) -> SettingValue:
    low, high = setting.tuned or (0, 0)
    if setting.kind is int:
        return trial.suggest_int(setting.name, int(low), int(high))
    return _rounded(trial.suggest_float(setting.name, low, high, step=_STEP))


def _rounded(value: SettingValue) -> SettingValue:
    """Without the rounding errors of adding steps: 0.3, not 0.30000000000000004."""
    return round(value, 6) if isinstance(value, float) else value
