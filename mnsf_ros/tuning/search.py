# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The search: trials of settings, chosen by Optuna, kept in a file so that it can be continued."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from mnsf_ros.errors import EvaluationError, SettingsError, library_missing
from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import Settings, declared_setting, declared_settings
from mnsf_ros.tuning.judges import Judgement

if TYPE_CHECKING:
    import optuna

# What settings are worth on a half of the recordings.
Trier = Callable[[Settings], Judgement]

_STUDY: Final = "tune"
_IDENTITY: Final = "identity"
_STEP: Final = 0.01
_NUM_RANDOM: Final = 10
# In place of infinity, which the sampler cannot compare.
_WORST: Final = 1e6
# Importance needs a few trials to compare.
_MIN_TRIALS: Final = 8


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


@dataclass(frozen=True)
class Budget:
    """When the search ends: after so many trials in all, or so many minutes, what comes first."""

    num_trials: int
    minutes: float = math.inf

    def __post_init__(self) -> None:
        if self.num_trials < 1 or not self.minutes > 0:
            raise SettingsError(
                f"budget: got {self.num_trials} trials and {self.minutes:g} minutes, expected 1 or "
                "more and above 0"
            )


class Search:
    """Trials of settings on recordings, and the best of them so far."""

    def __init__(self, path: Path, settings: Sequence[Setting], start: Settings, seed: int) -> None:
        """Opens the file of the trials, which is made with its folder if it is not there.

        Raises:
            SettingsError: Optuna is not installed.
        """
        try:
            import optuna
            from optuna.storages.journal import JournalFileBackend
        except ModuleNotFoundError as error:
            raise SettingsError(library_missing(error)) from error
        optuna.logging.set_verbosity(optuna.logging.ERROR)
        path.parent.mkdir(parents=True, exist_ok=True)
        self._settings = settings
        self._start = start
        self._seed = seed
        self._study = optuna.create_study(
            storage=optuna.storages.JournalStorage(JournalFileBackend(str(path))),
            study_name=_STUDY,
            load_if_exists=True,
        )

    def check_identity(self, identity: Mapping[str, object]) -> None:
        """Notes what is tuned on what; a search that is continued must be of the same.

        Raises:
            EvaluationError: It is another one.
        """
        text = json.dumps(dict(identity), sort_keys=True, default=str)
        known = self._study.user_attrs.get(_IDENTITY)
        if known is None:
            self._study.set_user_attr(_IDENTITY, text)
        elif known != text:
            before = json.loads(known)
            others = [name for name, value in json.loads(text).items() if before.get(name) != value]
            raise EvaluationError(
                f"cannot continue: {', '.join(others)} differ from those of the search in the "
                "folder; name another folder"
            )

    def run(self, judge: Trier, budget: Budget, watch: Callable[[int, float], None]) -> None:
        """Tries settings until the budget is spent; the first trial is the settings to start from.

        `watch` gets the number of trials that are done and the lowest cost, also at the start if
        there are any. A search that was interrupted goes on as if it had not been.
        """
        import optuna

        end_s = time.monotonic() + 60.0 * budget.minutes
        state = optuna.trial.TrialState
        for lost in self._study.get_trials(states=(state.RUNNING, state.WAITING)):
            self._study.tell(lost.number, state=state.FAIL)
        if self._done():
            watch(len(self._done()), self._study.best_value)
        while len(self._done()) < budget.num_trials and time.monotonic() < end_s:
            number = len(self._done())
            # A sampler of its own for each trial, so that it does not matter who made the last one.
            self._study.sampler = optuna.samplers.TPESampler(
                seed=self._seed + number, n_startup_trials=_NUM_RANDOM
            )
            if number == 0:
                self._study.enqueue_trial(dict(self.start_values))
            trial = self._study.ask()
            values = {one.name: _suggested(trial, one) for one in self._settings}
            cost = judge(self._start.changed(values)).cost
            self._study.tell(trial, min(cost, _WORST))
            watch(number + 1, self._study.best_value)

    @property
    def start_values(self) -> dict[str, SettingValue]:
        """The values of the parameters before the search."""
        return {one.name: self._start.value_of(one.name) for one in self._settings}

    @property
    def best_values(self) -> dict[str, SettingValue]:
        """The values of the best trial."""
        return {
            one.name: one.checked(_plain(self._study.best_params[one.name]))
            for one in self._settings
        }

    @property
    def trials(self) -> list[tuple[float, dict[str, SettingValue]]]:
        """Cost and values of each finished trial, in order."""
        return [
            (float(trial.value), {name: _plain(value) for name, value in trial.params.items()})
            for trial in self._done()
            if trial.value is not None
        ]

    @property
    def importances(self) -> dict[str, float]:
        """How much each parameter decides between good and bad trials: shares; NaN if few."""
        import optuna

        names = [one.name for one in self._settings]
        if len(self._done()) < _MIN_TRIALS or len(names) < 2:
            return dict.fromkeys(names, math.nan)
        evaluator = optuna.importance.PedAnovaImportanceEvaluator(target_quantile=0.25)
        found = optuna.importance.get_param_importances(self._study, evaluator=evaluator)
        return {name: found.get(name, math.nan) for name in names}

    def _done(self) -> list[optuna.trial.FrozenTrial]:
        import optuna

        return self._study.get_trials(deepcopy=False, states=(optuna.trial.TrialState.COMPLETE,))


def _suggested(trial: Any, setting: Setting) -> SettingValue:  # noqa: ANN401 - a trial of Optuna
    low, high = setting.tuned or (0, 0)
    if setting.kind is int:
        return int(trial.suggest_int(setting.name, int(low), int(high)))
    return float(_plain(trial.suggest_float(setting.name, low, high, step=_STEP)))


def _plain(value: Any) -> Any:  # noqa: ANN401 - int or float
    """Without the noise of adding steps: 0.3, not 0.30000000000000004."""
    return round(value, 6) if isinstance(value, float) else value
