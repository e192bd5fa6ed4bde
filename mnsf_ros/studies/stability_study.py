# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""How much a result changes when a single point of the sweeps is another one.

The paper's theorem bounds the change of the loss by a term that falls with one over the number of
points. Measured is what the bound is a bound of: a method runs on sweeps of N points, then on the
same sweeps with one point replaced by another of the full sweep, from the same start weights.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import astuple, dataclass, fields, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.stats import linregress

from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.drawing.study_charts import LogLine, log_lines
from mnsf_ros.errors import EvaluationError
from mnsf_ros.evaluation.metrics import mean
from mnsf_ros.evaluation.run_folder import check_folder
from mnsf_ros.methods import make_method
from mnsf_ros.report.text_table import TextTable, format_number
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings
from mnsf_ros.studies.study import StudyOptions, StudyResult, first_example
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

SWEEPS: Final = ("current", "next", "previous")
_TITLE: Final = "Stability: one point replaced"
_PARTS: Final = {"flow_m": "Change of flow (m)", "loss_m": "Change of loss (m)"}
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
class Change:
    """What replacing one point did.

    Attributes:
        method: Name of the method.
        num_points: Points N of each sweep.
        sweep: In which sweep: current, next or previous.
        repeat: Number of the draw.
        flow_m: Mean length of the change of flow over the points that stayed, metres.
        loss_m: Change of the mean distance of those points to the full next sweep, metres.
    """

    method: str
    num_points: int
    sweep: str
    repeat: int
    flow_m: float
    loss_m: float


def stability_settings(settings: Settings) -> Settings:
    """Returns settings that suit the study; what was set explicitly stays."""
    values = STABILITY_SETTINGS.items()
    return settings.changed({k: v for k, v in values if k not in settings.explicit})


def run_stability_study(options: StudyOptions) -> StudyResult:
    """Replaces points of the first example; its settings are best those of `stability_settings`.

    Raises:
        MnsfError: A recording, a setting or the folder cannot be used, or an estimate fails.
    """
    check_folder(options.out, resume=options.resume)
    settings = options.evaluation().settings
    estimators = {method: make_method(method, settings) for method in options.methods}
    triplet = first_example(options).triplet
    found: list[Change] = []
    for method, estimator in estimators.items():
        options.say(f"replacing points for {method}")
        found += changes(
            method, estimator, triplet, options.sizes, options.num_repeats, options.seed
        )
    return _result(found, options)


def changes(
    method: str,
    estimator: SceneFlowEstimator,
    triplet: SweepTriplet,
    sizes: Sequence[int],
    num_repeats: int,
    seed: int,
) -> Iterator[Change]:
    """Replaces points of the full sweeps and yields what that does.

    Each of the `sizes` must be less than the smallest sweep has points. For each, there are
    `num_repeats` draws, the same for all methods with the same seed.

    Raises:
        EvaluationError: A sweep has too few points.
        MnsfError: An estimate fails.
    """
    sweeps = _full_sweeps(triplet, max(sizes))
    tree = cKDTree(triplet.next.kept_xyz)
    for size in sizes:
        for repeat in range(num_repeats):
            random = np.random.default_rng([seed, size, repeat])
            # So many rows of each sweep, and one more.
            drawn = {
                name: random.choice(len(sweep), size + 1, replace=False)
                for name, sweep in sweeps.items()
            }
            usual = {name: rows[:-1] for name, rows in drawn.items()}
            before = estimator.estimate(_part(triplet, sweeps, usual)).flow
            for name in SWEEPS:
                # The last one drawn takes the place of the first.
                other = usual | {name: np.concatenate([drawn[name][-1:], usual[name][1:]])}
                after = estimator.estimate(_part(triplet, sweeps, other)).flow
                xyz = sweeps["current"].xyz[usual["current"]][1:]
                pair = (before[1:], after[1:])
                losses = [float(tree.query(xyz + flow)[0].mean()) for flow in pair]
                flow_m = float(np.linalg.norm(pair[1] - pair[0], axis=1).mean())
                yield Change(method, size, name, repeat, flow_m, abs(losses[1] - losses[0]))


def _full_sweeps(triplet: SweepTriplet, size: int) -> dict[str, Sweep]:
    """The kept points of each sweep, which must be more than `size`."""
    sweeps = {}
    for name in SWEEPS:
        sweep: Sweep | None = getattr(triplet, name)
        if sweep is None:
            raise EvaluationError(f"the triplet has no {name} sweep")
        sweeps[name] = sweep if sweep.kept is None else sweep.part(sweep.kept)
        if len(sweeps[name]) <= size:
            raise EvaluationError(
                f"sizes: got {size}, but the {name} sweep has {len(sweeps[name])} points, "
                "expected more"
            )
    return sweeps


def _part(
    triplet: SweepTriplet, sweeps: dict[str, Sweep], rows: dict[str, NDArray[np.int64]]
) -> SweepTriplet:
    current, following, previous = (sweeps[name].part(rows[name]) for name in SWEEPS)
    return replace(triplet, current=current, next=following, previous=previous, earlier=())


def mean_changes(found: Sequence[Change], method: str, sweep: str, part: str) -> dict[int, float]:
    """Returns number of points to mean change over the draws; part: `flow_m` or `loss_m`."""
    values: dict[int, list[float]] = {}
    for change in found:
        if (change.method, change.sweep) == (method, sweep):
            values.setdefault(change.num_points, []).append(getattr(change, part))
    return {size: mean(items) for size, items in sorted(values.items())}


def fitted_slope(means: dict[int, float]) -> tuple[float, float]:
    """Returns the slope of log(change) over log(number of points), and its standard error.

    A slope of -1 is one over N. Changes of exactly zero, as of a sweep that a method does not look
    at, have no logarithm and are left out. Fewer than two others have no slope, two no error: NaN.
    """
    known = [(size, value) for size, value in means.items() if value > 0]
    if len(known) < 2:
        return math.nan, math.nan
    line = linregress(*np.log(known).T)
    return float(line.slope), float(line.stderr) if len(known) > 2 else math.nan


def _result(found: Sequence[Change], options: StudyOptions) -> StudyResult:
    text = (
        f"Mean change over {options.num_repeats} draws when one of N points of one sweep is "
        "replaced by another, all else equal: start weights, and all other points. The slope is "
        "that of the logarithm of the change over the logarithm of N, with its standard error: -1 "
        "is one over N, as the theorem's bound falls. Methods that do not look at the previous "
        "sweep do not change with it. Fits end after the steps of the settings, converged or not, "
        "unless early stopping was asked for."
    )
    header = ["replaced in", *(f"N = {size:,}" for size in options.sizes), "slope"]
    tables: list[TextTable] = []
    panels: dict[str, list[LogLine]] = {}
    for part, words in _PARTS.items():
        cells, panels[words] = [], []
        for number, method in enumerate(options.methods):
            for look, sweep in enumerate(SWEEPS):
                means = mean_changes(found, method, sweep, part)
                values = (f"{means[size]:.2e}" for size in options.sizes)
                cells.append([f"{method}, {sweep} sweep", *values, _slope_text(means)])
                if known := {size: value for size, value in means.items() if value > 0}:
                    panels[words].append(LogLine(f"{method}, {sweep}", known, number, look))
        tables.append(TextTable(header, cells, words))
    return StudyResult(
        name="stability",
        title=_TITLE,
        texts=[text],
        tables=tables,
        header=[field.name for field in fields(Change)],
        rows=[astuple(change) for change in found],
        picture=log_lines(_TITLE, "points N of each sweep", options.sizes, panels),
    )


def _slope_text(means: dict[int, float]) -> str:
    """The slope, with its standard error if enough sizes had any change."""
    slope, error = fitted_slope(means)
    return format_number(slope, 2) if math.isnan(error) else f"{slope:.2f} ± {error:.2f}"
