# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tuning: Optuna searches settings on the first halves of recordings, the second halves judge.

A search is resumed from Optuna's journal of trials.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from mnsf_ros.errors import EvaluationError, SettingsError, library_missing, one_line
from mnsf_ros.evaluation.options import SET_BY_EVALUATOR, EvaluationOptions
from mnsf_ros.evaluation.recordings import EvaluatedRecording
from mnsf_ros.evaluation.run_folder import check_folder
from mnsf_ros.setting import Setting, SettingValue
from mnsf_ros.settings import Settings, declared_setting, declared_settings
from mnsf_ros.settings_documents import settings_yaml
from mnsf_ros.tuning.judges import ConsistencyJudge, LabelledJudge, read_halves
from mnsf_ros.tuning.options import AUTO, CONSISTENCY, EPE, TuneOptions

if TYPE_CHECKING:
    import optuna

TRIALS_FILE: Final = "trials.log"
PARAMETER_FILE: Final = "tuned.yaml"
_IDENTITY: Final = "identity"
_STEP: Final = 0.01
# In place of infinity, which the sampler cannot compare.
_WORST: Final = 1e6

Values = dict[str, SettingValue]
# Gets a text, the number of steps done, and their number in all.
Watch = Callable[[str, int, int], None]


@dataclass(frozen=True)
class SearchResult:
    """Result of a search."""

    start: Settings  # before the search
    goal: str  # name and unit of the cost
    num_trials: int
    changed: Values  # full names and new values of changed parameters
    tuned: tuple[float, float]  # costs on the half that was tuned, before and after
    held_out: tuple[float, float]  # the same on the other half

    @property
    def lines(self) -> list[str]:
        """A line for each changed parameter, and one on whether the changes help."""
        if not self.changed:
            return [
                f"No change of a parameter gains anything in {self.num_trials} trials: keep the "
                "settings as they are; no parameter file is written."
            ]
        before, after = self.held_out
        verdict = (
            f"{self.goal} of the tuned half: {self.tuned[0]:.4f} -> {self.tuned[1]:.4f}; of the "
            f"half that was not tuned: {before:.4f} -> {after:.4f}"
        )
        better = f", {1 - after / before:.1%} less."
        verdict += better if after < before else ". Not better: keep the settings as they are."
        names = self.changed.items()
        return [*(f"{n}: {self.start.value_of(n)} -> {value}" for n, value in names), verdict]

    def write_parameters(self, folder: Path, command: str) -> Path | None:
        """Writes the parameter file, if anything changes, and returns its path.

        Raises:
            OSError: Writing fails.
        """
        path = folder / PARAMETER_FILE
        if not self.changed:  # and none of an earlier search
            path.unlink(missing_ok=True)
            return None
        title = f"Written by `{command}`. {self.lines[-1]}"
        text = settings_yaml(self.start.changed(self.changed), title, self.changed)
        path.write_text(text, encoding="utf-8")
        return path


def tune(
    recordings: Sequence[EvaluatedRecording],
    evaluation: EvaluationOptions,
    options: TuneOptions,
    folder: Path,
    watch: Watch,
    *,
    resume: bool = False,
) -> SearchResult:
    """Searches for better settings and judges them on the halves that were not tuned.

    The search starts at the settings of the evaluation; explicit ones are not tuned. Each half has
    at most `max_examples` of the evaluation. The trials are in the folder.

    Raises:
        MnsfError: An option or a recording cannot be used, or the folder has another search.
    """
    start, goal = evaluation.settings, _goal(options.goal, recordings)
    fixed = start.explicit - {*SET_BY_EVALUATOR}
    names = [one.name for one in tuned_settings(options.names, fixed)]
    identity = {
        **evaluation.identity,
        "goal": goal,
        "parameters": names,
        **{one.name: one.identity for one in recordings},
    }
    study = _open_study(folder, identity, evaluation.seed, resume=resume)
    tuned, held_out = (
        ConsistencyJudge(half, start, evaluation.seed)
        if goal == CONSISTENCY
        else LabelledJudge(half)
        for half in read_halves(recordings, evaluation)
    )

    before = {name: start.value_of(name) for name in names}
    best = _best_values(study, before, options.trials, watch, lambda v: tuned(start.changed(v)))
    changed = {name: value for name, value in best.items() if value != before[name]}
    watch("judging on the other half", options.trials, options.trials)
    on_tuned, on_other = (
        (judge(start), judge(start.changed(changed))) for judge in (tuned, held_out)
    )
    return SearchResult(start, tuned.goal, _num_done(study), changed, on_tuned, on_other)


def _goal(wanted: str, recordings: Sequence[EvaluatedRecording]) -> str:
    unlabelled = [one.name for one in recordings if one.truth is None]
    if wanted == EPE and unlabelled:
        raise EvaluationError(
            f"--goal {EPE} needs true flow, which {', '.join(unlabelled)} has not; use --goal "
            f"{CONSISTENCY}"
        )
    by_truth = CONSISTENCY if unlabelled else EPE
    return by_truth if wanted == AUTO else wanted


def tuned_settings(names: Sequence[str] = (), fixed: frozenset[str] = frozenset()) -> list[Setting]:
    """Returns the settings to tune: those named, else all with a range to tune; none of the fixed.

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
    """Checks that Optuna is installed; raises a SettingsError if not."""
    try:
        import optuna
    except ModuleNotFoundError as error:
        raise SettingsError(library_missing(error)) from error
    optuna.logging.set_verbosity(optuna.logging.ERROR)


def _open_study(
    folder: Path, identity: Mapping[str, object], seed: int, *, resume: bool
) -> "optuna.Study":
    """Opens the trials in a folder; costs depend on the values of `identity`."""
    import optuna
    from optuna.storages.journal import JournalFileBackend

    path = folder / TRIALS_FILE
    check_folder(folder, resume=resume)
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
    if others := [name for name, text in texts.items() if known.get(name) != text]:
        raise EvaluationError(
            f"cannot continue: {', '.join(others)} differ from those of the search in the "
            "folder; name another folder"
        )
    study.set_user_attr(_IDENTITY, texts)
    return study


def _best_values(
    study: "optuna.Study",
    start: Values,
    num_trials: int,
    watch: Watch,
    cost_of: Callable[[Values], float],
) -> Values:
    """Runs the trials that are left, the first one with the values `start`."""
    settings = [declared_setting(name) for name in start]

    def tried(trial: "optuna.Trial") -> float:
        return min(cost_of({one.name: _suggested(trial, one) for one in settings}), _WORST)

    def say(study: "optuna.Study", _: object) -> None:
        text = f"trials, lowest cost {study.best_value:.4f}"
        watch(text, _num_done(study), num_trials)

    if not _num_done(study):
        study.enqueue_trial(dict(start))
    if (num_left := num_trials - _num_done(study)) > 0:
        study.optimize(tried, num_left, callbacks=[say])
    return {one.name: one.checked(_rounded(study.best_params[one.name])) for one in settings}


def _num_done(study: "optuna.Study") -> int:
    return sum(trial.value is not None for trial in study.get_trials(deepcopy=False))


def _suggested(trial: "optuna.Trial", setting: Setting) -> SettingValue:
    low, high = setting.tuned or (0, 0)
    if setting.kind is int:
        return trial.suggest_int(setting.name, int(low), int(high))
    return _rounded(trial.suggest_float(setting.name, low, high, step=_STEP))


def _rounded(value: SettingValue) -> SettingValue:
    """Without the rounding errors of adding steps: 0.3, not 0.30000000000000004."""
    return round(value, 6) if isinstance(value, float) else value
