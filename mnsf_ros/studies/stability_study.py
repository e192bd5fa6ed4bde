"""The theorem's 1/N: single points are replaced, and the change of the result is measured."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from mnsf_ros.drawing.study_charts import LogLine, log_lines
from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.run_start import check_folder
from mnsf_ros.evaluation.tables import TextTable, format_number
from mnsf_ros.methods import make_method
from mnsf_ros.settings import Settings, SettingValue
from mnsf_ros.studies.point_stability import (
    SWEEPS,
    Change,
    Slope,
    changes,
    fitted_slope,
    mean_changes,
)
from mnsf_ros.studies.study import StudyOptions, StudyResult
from mnsf_ros.studies.study_examples import first_example

METHODS: Final = ("nsfp", "fnsf", "mnsf")
_TITLE: Final = "Stability: one point replaced"
_PARTS: Final = {"flow_m": "change of flow (m)", "loss_m": "change of loss (m)"}
_MIN_SIZES: Final = 3
# The one that is replaced, and one that stays.
_MIN_POINTS: Final = 2
# The theorem speaks of the optimum, not of when a noisy loss happens to look converged: a step
# more or less changes the flow far more than a point does. So all fits get the same steps.
STABILITY_SETTINGS: Final[dict[str, SettingValue]] = {
    "distance.kind": "tree",
    "optimization.max_iterations": 60,
    "optimization.decay": True,
    "optimization.batch_points": 0,
    "fusion.max_iterations": 60,
    "early_stopping.patience": 0,
    "fusion.patience": 0,
    "nsfp.patience": 0,
    "warm_start.enabled": False,
}


@dataclass(frozen=True)
class StabilityOptions:
    """How to measure stability.

    Attributes:
        sizes: Numbers of points, ascending; three or more, for a slope with its standard error.
        num_repeats: Draws of points for each of them.
        methods: Names of the methods.
    """

    sizes: tuple[int, ...] = (128, 256, 512, 1024, 2048)
    num_repeats: int = 5
    methods: tuple[str, ...] = METHODS

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            EvaluationError: If one is out of its range.
        """
        told = ", ".join(map(str, self.sizes))
        if len(self.sizes) < _MIN_SIZES or list(self.sizes) != sorted(set(self.sizes)):
            raise EvaluationError(
                f"sizes: got {told}, expected {_MIN_SIZES} or more numbers in ascending order"
            )
        if self.sizes[0] < _MIN_POINTS:
            raise EvaluationError(f"sizes: got {told}, expected {_MIN_POINTS} points or more each")
        if self.num_repeats < 1:
            raise EvaluationError(f"repeats: got {self.num_repeats}, expected 1 or more")
        if len(set(self.methods)) < len(self.methods):
            raise EvaluationError(f"methods: got {', '.join(self.methods)}, expected each once")


def stability_settings(settings: Settings) -> Settings:
    """Returns settings that suit the study; what was set explicitly stays."""
    values = STABILITY_SETTINGS.items()
    return settings.changed({k: v for k, v in values if k not in settings.explicit})


def run_stability_study(options: StudyOptions, how: StabilityOptions | None = None) -> StudyResult:
    """Replaces points of the first example. Settings are taken as they are.

    Raises:
        MnsfError: A recording, a setting or the folder cannot be used, or an estimate fails.
    """
    how = how or StabilityOptions()
    check_folder(options.out, resume=options.resume)
    settings = options.evaluation().method_settings
    estimators = {method: make_method(method, settings) for method in how.methods}
    triplet = first_example(options).triplet
    found: list[Change] = []
    for method, estimator in estimators.items():
        options.say(f"replacing points for {method}")
        found += changes(method, estimator, triplet, how.sizes, how.num_repeats, options.seed)
    return stability_result(found, how)


def stability_result(found: Sequence[Change], how: StabilityOptions) -> StudyResult:
    """Puts changes into tables, rows and a picture."""
    text = (
        f"Mean change over {how.num_repeats} draws when one of N points of one sweep is replaced "
        "by another, all else equal: start weights, and all other points. The slope is that of "
        "the logarithm of the change over the logarithm of N, with its standard error: -1 is one "
        "over N, as the theorem's bound falls. Methods that do not look at the previous sweep "
        "do not change with it. Fits end after the steps of the settings, converged or not, "
        "unless early stopping was asked for."
    )
    rows = [(c.method, c.num_points, c.sweep, c.repeat, c.flow_m, c.loss_m) for c in found]
    return StudyResult(
        name="stability",
        title=_TITLE,
        texts=[text],
        tables=[_table(found, how, part, words) for part, words in _PARTS.items()],
        header=("method", "num_points", "sweep", "repeat", "flow_m", "loss_m"),
        rows=rows,
        picture=_picture(found, how),
    )


def _table(found: Sequence[Change], how: StabilityOptions, part: str, words: str) -> TextTable:
    rows = []
    for method in how.methods:
        for sweep in SWEEPS:
            means = mean_changes(found, method, sweep, part)
            line = fitted_slope(means)
            cells = [f"{means[size]:.2e}" for size in how.sizes]
            rows.append([f"{method}, {sweep} sweep", *cells, _slope_text(line)])
    header = ["replaced in", *(f"N = {size:,}" for size in how.sizes), "slope"]
    return TextTable(header, rows, words[0].upper() + words[1:])


def _slope_text(line: Slope) -> str:
    """The slope, with its standard error if enough sizes had any change."""
    if math.isnan(line.deviation):
        return format_number(line.slope, 2)
    return f"{line.slope:.2f} ± {line.deviation:.2f}"


def _picture(found: Sequence[Change], how: StabilityOptions) -> bytes:
    panels: dict[str, list[LogLine]] = {words: [] for words in _PARTS.values()}
    for part, words in _PARTS.items():
        for number, method in enumerate(how.methods):
            for look, sweep in enumerate(SWEEPS):
                means = mean_changes(found, method, sweep, part)
                known = {size: value for size, value in means.items() if value > 0}
                if known:
                    panels[words].append(LogLine(f"{method}, {sweep}", known, number, look))
    return log_lines(_TITLE, "points N of each sweep", how.sizes, panels)
