# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The search by Optuna; its file of trials is the state from which a search is resumed."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import EvaluationError, SettingsError, library_missing
from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import declared_setting, declared_settings

if TYPE_CHECKING:
    import optuna

TRIALS_FILE: Final = "trials.log"
_IDENTITY: Final = "identity"
_STEP: Final = 0.01
# In place of infinity, which the sampler cannot compare.
_WORST: Final = 1e6

Values = dict[str, SettingValue]


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


def open_study(
    folder: Path, identity: Mapping[str, object], seed: int, *, resume: bool
) -> optuna.Study:
    """Opens the trials in a folder, which is made if it is not there.

    Raises:
        EvaluationError: The folder has trials and `resume` is false, or they are of a search with
            another identity: recordings, settings and options on which costs depend.
    """
    import optuna
    from optuna.storages.journal import JournalFileBackend

    path = folder / TRIALS_FILE
    if path.exists() and not resume:
        raise EvaluationError(f"{folder}: exists already; name another folder, or add --resume")
    folder.mkdir(parents=True, exist_ok=True)
    storage = optuna.storages.JournalStorage(JournalFileBackend(str(path)))
    study = optuna.create_study(storage=storage, study_name="tune", load_if_exists=True)
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


def run_trials(
    study: optuna.Study,
    start: Values,
    num_trials: int,
    timeout_s: float | None,
    cost_of: Callable[[Values], float],
    watch: Callable[[int, float], None],
) -> Values:
    """Runs trials until there are so many in all, or for so long; returns the best values.

    The first trial has the values `start`. After each one `watch` gets the number of trials and
    the lowest cost.
    """
    settings = [declared_setting(name) for name in start]

    def tried(trial: optuna.Trial) -> float:
        return min(cost_of({one.name: _suggested(trial, one) for one in settings}), _WORST)

    def say(study: optuna.Study, _: object) -> None:
        watch(num_done(study), study.best_value)

    if not num_done(study):
        study.enqueue_trial(dict(start))
    if (num_left := num_trials - num_done(study)) > 0:
        study.optimize(tried, num_left, timeout_s, callbacks=[say])
    return {one.name: one.checked(_rounded(study.best_params[one.name])) for one in settings}


def num_done(study: optuna.Study) -> int:
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
