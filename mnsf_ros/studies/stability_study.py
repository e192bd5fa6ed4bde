# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Change of a result when a single point of the sweeps is replaced.

The paper's theorem bounds the change of the loss by a term that falls with one over the number of
points. The study measures that change: a method runs on sweeps of N points, then on the same sweeps
with one point replaced by another of the full sweep, from the same start weights.
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import product
from typing import Final

import numpy as np
import pandas as pd
from scipy.spatial import cKDTree
from scipy.stats import linregress

from mnsf_ros.arrays import Ints
from mnsf_ros.core.scene_flow_estimator import SceneFlowEstimator
from mnsf_ros.errors import EvaluationError
from mnsf_ros.methods import make_method
from mnsf_ros.report.text_table import TextTable, format_number
from mnsf_ros.setting import SettingValue
from mnsf_ros.settings import Settings
from mnsf_ros.studies.settings import numbers_of
from mnsf_ros.studies.study import StudyOptions, StudyResult
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

SWEEPS: Final = ("current", "next", "previous")
_TITLE: Final = "Stability: one point replaced"
_PARTS: Final = {"flow_m": "Change of flow (m)", "loss_m": "Change of loss (m)"}
# The theorem is about the optimum. Early stopping on a noisy loss would change the flow far more
# than a point does, so all fits get the same number of steps.
STABILITY_SETTINGS: Final[dict[str, SettingValue]] = {
    "distance.kind": "tree",
    "optimization.max_iterations": 60,
    "optimization.decay": True,
    "fusion.max_iterations": 60,
    "early_stopping.patience": 0,
    "fusion.patience": 0,
    "nsfp.patience": 0,
    "warm_start.enabled": False,
}


def run(_name: str, options: StudyOptions) -> StudyResult:
    """Replaces points of the first example, of all of its points.

    Raises:
        MnsfError: A recording or a setting cannot be used, or an estimate fails.
    """
    settings = stability_settings(options.evaluation.settings)
    evaluation = replace(options.evaluation, settings=settings, num_points=0)
    options = replace(options, evaluation=evaluation)
    estimators = {name: make_method(name, settings) for name in options.case.method_names}
    triplet = options.first_example().triplet
    found: list[dict[str, object]] = []
    for method, estimator in estimators.items():
        options.say(f"replacing points for {method}")
        found += changes(method, estimator, triplet, options)
    return _result(pd.DataFrame(found), options)


def stability_settings(settings: Settings) -> Settings:
    """Returns the settings of the study; explicit ones stay."""
    values = STABILITY_SETTINGS.items()
    return settings.changed({k: v for k, v in values if k not in settings.explicit})


def changes(
    method: str, estimator: SceneFlowEstimator, triplet: SweepTriplet, options: StudyOptions
) -> Iterator[dict[str, object]]:
    """Replaces points of the full sweeps, drawn by the seed.

    Yields:
        The effect of each replacement: `method`, `num_points` of each sweep, the changed `sweep`,
        number `repeat` of the draw, `flow_m` (mean length of the change of flow over the points
        that stayed) and `loss_m` (change of their mean distance to the full next sweep).

    Raises:
        MnsfError: A sweep has too few points, or an estimate fails.
    """
    sizes = numbers_of(options.case.sizes)
    sweeps = _full_sweeps(triplet, max(sizes))
    tree = cKDTree(triplet.next.kept_xyz)
    for size, repeat in product(sizes, range(options.case.repeats)):
        random = np.random.default_rng([options.evaluation.seed, size, repeat])
        # `size` rows of each sweep, and one more.
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
            yield {
                **{"method": method, "num_points": size, "sweep": name, "repeat": repeat},
                **{"flow_m": flow_m, "loss_m": abs(losses[1] - losses[0])},
            }


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


def _part(triplet: SweepTriplet, sweeps: dict[str, Sweep], rows: dict[str, Ints]) -> SweepTriplet:
    current, following, previous = (sweeps[name].part(rows[name]) for name in SWEEPS)
    return replace(triplet, current=current, next=following, previous=previous, earlier=())


def fitted_slope(means: pd.Series) -> tuple[float, float]:
    """Returns the slope of log(change) over log(number of points), and its standard error.

    The index of `means` is the number of points. A slope of -1 is one over N. Changes of exactly
    zero, as of a sweep that a method does not use, are left out. The slope needs two others, its
    error three, else it is NaN.
    """
    known = means[means > 0]
    if len(known) < 2:
        return math.nan, math.nan
    line = linregress(np.log(known.index), np.log(known))
    return float(line.slope), float(line.stderr) if len(known) > 2 else math.nan


def _result(found: pd.DataFrame, options: StudyOptions) -> StudyResult:
    text = (
        f"Mean change over {options.case.repeats} draws when one of N points of one sweep is "
        "replaced by another, all else equal: start weights, and all other points. The slope is "
        "that of the logarithm of the change over the logarithm of N, with its standard error: -1 "
        "is one over N, as the theorem's bound falls. Methods that do not look at the previous "
        "sweep do not change with it. Fits end after the steps of the settings, converged or not, "
        "unless early stopping was asked for."
    )
    sizes = numbers_of(options.case.sizes)
    header = ["replaced in", *(f"N = {size:,}" for size in sizes), "slope"]
    tables: list[TextTable] = []
    for part, words in _PARTS.items():
        means = found.pivot_table(part, "num_points", ["method", "sweep"], sort=False)
        cells = [
            [f"{method}, {sweep} sweep", *map("{:.2e}".format, own), _slope_text(own)]
            for (method, sweep), own in means.items()
        ]
        tables.append(TextTable(header, cells, words))
    return StudyResult(_TITLE, [text], tables, found, options.evaluation)


def _slope_text(means: pd.Series) -> str:
    slope, error = fitted_slope(means)
    return format_number(slope, 2) if math.isnan(error) else f"{slope:.2f} ± {error:.2f}"
