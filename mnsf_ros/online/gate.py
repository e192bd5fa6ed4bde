# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The gate: all evidence that an object moves in one number, and its limits."""

from typing import Final

import numpy as np
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import connected_components

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.core.reason import Verdict
from mnsf_ros.geometry.point_grid import PointGrid
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.online.motions import JudgedMotions, are_same, judge, residual_rise_m
from mnsf_ros.online.object_points import NOISE_M, ObjectPoints
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.target import Targets
from mnsf_ros.online.travelling_views import are_travelling_views
from mnsf_ros.settings import ObjectSettings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# Logistic regression, one weight for each column of `evidence`. `benchmarks/fit_weights.py` fits
# them to random worlds and KITTI. They were then adjusted to balance found and false movers. The
# last, for parts, is set so that at the limit half of the parts that move alone are found.
_WEIGHTS: Final = (-2.05, 0.9, 0.4, -3.1, -0.42, -0.18, 0.35, -2.0)
# Objects whose log-odds miss the limit by up to this are only followed.
_TENTATIVE: Final = 2.0
# Slower motions are within the noise of the ranges over a usual interval.
_MIN_SPEED_M_S: Final = NOISE_M / USUAL_INTERVAL_S


def with_verdicts(table: ObjectTable, scene: Scene) -> ObjectTable:
    """Weighs the evidence for the motions of the open objects, and decides which of them move.

    Near objects that move, or may move, alike become a group: if one of it moves, all do.
    """
    rows = table.open_rows
    table = _with_evidence(table, rows, scene)
    suspects = table.select(rows)
    numbers, wholes, motions = suspects.points.numbers, suspects.wholes, suspects.fitted.motions
    is_followed, is_moving = moves(
        numbers, wholes, motions, suspects.log_odds, scene.usual_interval_s, scene.settings
    )
    table = _with_groups(table, rows[is_followed], scene)
    groups = table.groups[rows]
    is_moving = np.isin(groups, groups[is_moving])
    verdicts = np.full(len(rows), Verdict.REFUSED, object)
    verdicts[np.isin(numbers, wholes[is_moving])] = Verdict.PARTLY
    verdicts[is_moving] = Verdict.DYNAMIC
    return table.put(rows, verdicts=verdicts)


def _with_evidence(table: ObjectTable, rows: Ints, scene: Scene) -> ObjectTable:
    """Fills `num_new_or_gone`, `evidence` and `log_odds` of some objects."""
    suspects = table.select(rows)
    points, motions = suspects.points, suspects.fitted.motions
    static = judge(points, scene.targets, np.zeros_like(motions))
    num_new_or_gone = free_space(points, scene.targets, motions)
    are_views = are_travelling_views(points, motions, scene.targets.next)
    features = evidence(suspects, static, num_new_or_gone, are_views)
    return table.put(
        rows,
        num_new_or_gone=num_new_or_gone,
        evidence=features,
        log_odds=moving_log_odds(features),
    )


def _with_groups(table: ObjectTable, rows: Ints, scene: Scene) -> ObjectTable:
    """Fills `residual_rise` and `groups` of the objects that are followed."""
    followed = table.select(rows)
    points, fitted = followed.points, followed.fitted
    groups = mover_groups(points, fitted.motions, *points.all_points(scene.current))
    rise = residual_rise_m(points, fitted, scene.targets)
    return table.put(rows, residual_rise=rise, groups=groups)


def moving_log_odds(features: Floats) -> Floats:
    """Returns (K,) log-odds that objects with some evidence (K, 8) move."""
    return (features * np.asarray(_WEIGHTS)).sum(axis=1)


def free_space(objects: ObjectPoints, targets: Targets, motions: Floats32) -> Floats:
    """Returns (K,) the number of points that free space shows to be new or gone.

    New: the points of an object that are in free space of another sweep if it is static, less
    those if it moves. Gone: points of older sweeps that lie on the moved object and whose places
    are free by now; for a part, points of the rest of its whole do not count. A place that was
    seen through is evidence of motion. A place that was hidden, or out of view, is not: a static
    object leaves a residual there, too.

    Args:
        objects: K objects.
        targets: The other sweeps.
        motions: (K, 3) metres, to the next sweep.
    """
    current = targets.next.current
    rows = objects.rows_of(current.num_objects)[current.thinned_objects]
    points, owners = chosen_points(current.thinned, rows >= 0), rows[rows >= 0]
    num_new_or_gone = np.zeros(len(objects))
    for target in (*targets.past, *targets.near):
        num_new_or_gone += target.num_free(objects, np.zeros_like(motions))
        num_new_or_gone -= target.num_free(objects, motions)
    for target in targets.past or targets.near:
        places = points + np.take(target.displacements(objects, motions), owners, axis=0)
        num_new_or_gone += np.bincount(owners[target.rows_of_gone(places)], minlength=len(objects))
    return num_new_or_gone


def evidence(
    table: ObjectTable, static: JudgedMotions, num_new_or_gone: Floats, are_views: Bools
) -> Floats:
    """Returns (K, 8) features for and against the motions of K objects.

    The columns are:

    * 1;
    * log(1 + points new or gone); 0 for parts, because free space defined them;
    * the log-odds of the track so far;
    * log(1 + length of the motion in metres), 0 for a motion that a track predicts;
    * three products of S: with log(1 + thickness / noise), with log(number of points), and with
      the height of the top above the sensor in metres. S sums the logarithms of the shares of the
      residual that the motion leaves in the neighbouring and in the older sweeps; without older
      ones, the neighbouring ones count twice. It is 0 for views that travel with the sensor;
    * whether it is a part: most parts move with their wholes.

    Args:
        table: K objects whose motions were found.
        static: Residuals of the objects as static.
        num_new_or_gone: (K,) see `free_space`.
        are_views: (K,) see `are_travelling_views`.
    """
    objects, prior, fitted = table.points, table.prior, table.fitted
    are_parts = table.wholes != objects.numbers
    lengths = np.sqrt((fitted.motions**2).sum(axis=1))
    is_predicted = prior.has_track & are_same(fitted.motions, prior.motions)
    shares = _log_share(fitted.near_mean, static.near_mean) + _log_share(
        fitted.past_mean, static.past_mean
    )
    shares = np.where(are_views, 0.0, shares)
    thicknesses = np.log1p(objects.thicknesses / NOISE_M)
    columns = (
        np.ones(len(table)),
        np.log1p(np.where(are_parts, 0.0, np.maximum(num_new_or_gone, 0.0))),
        prior.log_odds,
        np.log1p(lengths) * ~is_predicted,
        shares * thicknesses,
        shares * np.log(objects.counts),
        shares * objects.tops,
        are_parts,
    )
    return np.stack(columns, axis=1).astype(np.float64)


def _log_share(moving: Floats, static: Floats) -> Floats:
    return np.log((moving + NOISE_M) / (static + NOISE_M))


def moves(
    numbers: Ints,
    wholes: Ints,
    motions: Floats32,
    log_odds: Floats,
    interval_s: float,
    settings: ObjectSettings,
) -> tuple[Bools, Bools]:
    """Returns masks (K,) of the objects that are followed, and of those that move.

    Only the likelier of a part and its whole may move: the whole is static, or the part moves with
    it.

    Args:
        numbers: (K,) the objects.
        wholes: (K,) the object that each was cut out of, else its own number.
        motions: (K, 3) metres, to the next sweep.
        log_odds: (K,) that they move, see `moving_log_odds`.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    are_parts = wholes != numbers
    lengths = np.hypot(motions[:, 0], motions[:, 1])
    is_possible = lengths > _MIN_SPEED_M_S * interval_s
    is_possible &= lengths <= settings.max_speed_m_s * interval_s
    limit = np.log(settings.min_probability / (1 - settings.min_probability))
    is_followed = is_possible & (log_odds > limit - _TENTATIVE)
    alone, best = are_parts & is_followed, np.full(numbers.max(initial=0) + 1, -np.inf)
    np.maximum.at(best, wholes[alone], log_odds[alone])
    is_followed &= are_parts | (log_odds >= best[numbers])
    is_followed &= ~are_parts | ~np.isin(wholes, numbers[is_followed])
    return is_followed, is_followed & (log_odds > limit)


def mover_groups(movers: ObjectPoints, motions: Floats32, points: Floats32, owners: Ints) -> Ints:
    """Returns (K,) the group, from 0, of each of K movers in reach of each other that move alike.

    Args:
        movers: K objects that move.
        motions: (K, 3) metres, their motions to the next sweep.
        points: (A, 3) metres, all their points: the chosen points of long ones are far apart.
        owners: (A,) the rows of their movers.
    """
    if len(movers) == 0:
        return np.zeros(0, np.int64)
    are_near = PointGrid(points).within_reach(movers.positions, movers.owners, owners)
    np.fill_diagonal(are_near, val=False)
    first, second = np.nonzero(are_near)
    is_one = are_same(motions[first], motions[second])
    ones = np.ones(np.count_nonzero(is_one), np.int8)
    graph = coo_matrix((ones, (first[is_one], second[is_one])), shape=(len(movers),) * 2)
    return connected_components(graph, directed=False)[1].astype(np.int64)
