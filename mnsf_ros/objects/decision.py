# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Which objects move: all evidence in one number, and its limits."""

from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import Verdict
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.objects.motions import JudgedMotions, are_same, held_m, judge
from mnsf_ros.objects.object_points import NOISE_M, ObjectPoints
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.sightings import mover_groups
from mnsf_ros.objects.table import ObjectTable
from mnsf_ros.objects.target import Targets
from mnsf_ros.settings import ObjectSettings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# Logistic regression, one number for each column of `evidence`: as `benchmarks/fit_weights.py`
# fits them to random worlds and KITTI, then balanced between found and false movers: the last, for
# parts, so that at the limit half of those that move alone do.
_WEIGHTS: Final = (-2.05, 0.9, 0.4, -3.1, -0.42, -0.18, 0.35, -2.0)
# Objects whose odds are lower than asked for by up to this (logarithm) are only followed.
_TENTATIVE: Final = 2.0


def decided(table: ObjectTable, scene: Scene) -> ObjectTable:
    """Weighs the evidence for the motions of the objects that are not rejected yet.

    Rejects those that do not move, and puts together what moves, or may move, as one thing.
    """
    rows, targets, current = table.open_rows, scene.targets, scene.current
    fitted = table.take(rows)
    points, motions = fitted.points, fitted.moving.motions
    standing = judge(points, targets, np.zeros_like(motions))
    free = free_space(points, targets, motions)
    features = evidence(fitted, standing, free)
    scores = moving_scores(features)
    table = table.put(rows, free=free, evidence=features, scores=scores)
    may_move, is_moving = moves(
        points.numbers, fitted.wholes, motions, scores, scene.usual_interval_s, scene.settings
    )
    followed = fitted.take(np.flatnonzero(may_move))
    groups = mover_groups(
        followed.points, followed.moving.motions, *followed.points.all_points(current)
    )
    held = held_m(followed.points, followed.moving, targets)
    table = table.put(rows[may_move], held=held, groups=groups)
    # What goes along with a mover is a part of it.
    is_moving[may_move] = np.isin(groups, groups[is_moving[may_move]])
    stands_beside = np.isin(points.numbers, fitted.wholes[is_moving])
    table = table.rejected(rows[~is_moving], Verdict.REFUSED)
    return table.rejected(rows[~is_moving & stands_beside], Verdict.PARTLY)


def moving_scores(features: NDArray[np.float64]) -> NDArray[np.float64]:
    """Returns (K,) logarithm of the odds that objects with some evidence (K, 8) move."""
    return (features * np.asarray(_WEIGHTS)).sum(axis=1)


def free_space(
    objects: ObjectPoints, targets: Targets, motions: NDArray[np.float32]
) -> NDArray[np.float64]:
    """Returns (K,) how many more points are in free space of another sweep if objects stand.

    These are the points of an object that are there if it stands, less those if it moves, and the
    points that older sweeps had of it, if it moves, and that are gone: beside a part, none of its
    whole. A place that was seen through is evidence of motion. One that was hidden, or beside the
    beams, is none: there a static object leaves a residual, too.

    Args:
        objects: K objects.
        targets: The other sweeps.
        motions: (K, 3) metres, to the next sweep.
    """
    current = targets.near[0].current
    rows = objects.rows_of(current.num_objects)[current.thinned_objects]
    points, owners = chosen_points(current.thinned, rows >= 0), rows[rows >= 0]
    free = np.zeros(len(objects))
    for target in (*targets.past, *targets.near):
        free += target.num_free(objects, np.zeros_like(motions))
        free -= target.num_free(objects, motions)
    for target in targets.past or targets.near:
        places = points + np.take(target.shifts(objects, motions), owners, axis=0)
        free += np.bincount(owners[target.rows_of_gone(places)], minlength=len(objects))
    return free


def evidence(
    table: ObjectTable, standing: JudgedMotions, free: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Returns (K, 8) features for and against the motions of K objects.

    These are: 1; the logarithm of the number of points in free space; the odds so far; the
    logarithm of one metre more than a motion that no track expected. And the logarithm of the share
    of the residual that the motion leaves in the neighbouring sweeps, plus that of the older ones,
    or of the neighbouring ones once more where there are none: times the logarithm of the
    thickness, times that of the number of points, and times the metres from the sensor up to its
    top. And whether it is a part: most move with their wholes. Free space says nothing of those,
    as that their places were free is why they are parts.

    Args:
        table: K objects whose motions were found.
        standing: How well they are explained as static.
        free: (K,) see `free_space`.
    """
    objects, expected, moving = table.points, table.expected, table.moving
    are_parts = table.wholes != objects.numbers
    lengths = np.sqrt((moving.motions**2).sum(axis=1))
    is_same = expected.is_known & are_same(moving.motions, expected.motions)
    shares = _log_share(moving.cost, standing.cost) + _log_share(moving.older, standing.older)
    thicknesses = np.log1p(objects.thicknesses / NOISE_M)
    columns = (
        np.ones(len(table)),
        np.log1p(np.where(are_parts, 0.0, np.maximum(free, 0.0))),
        expected.scores,
        np.log1p(lengths) * ~is_same,
        shares * thicknesses,
        shares * np.log(objects.counts),
        shares * objects.tops,
        are_parts,
    )
    return np.stack(columns, axis=1).astype(np.float64)


def _log_share(part: NDArray[np.float64], whole: NDArray[np.float64]) -> NDArray[np.float64]:
    return np.log((part + NOISE_M) / (whole + NOISE_M))


def moves(
    numbers: NDArray[np.int64],
    wholes: NDArray[np.int64],
    motions: NDArray[np.float32],
    scores: NDArray[np.float64],
    interval_s: float,
    settings: ObjectSettings,
) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
    """Returns masks (K,) of the objects that may move and are followed, and of those that move.

    Of a part and its whole the likelier one does: the whole stands, or the part goes along.

    Args:
        numbers: (K,) the objects.
        wholes: (K,) what each of them was cut out of, else itself.
        motions: (K, 3) metres, to the next sweep.
        scores: (K,) logarithm of the odds that they move, see `moving_scores`.
        interval_s: Time to the next sweep.
        settings: Settings of the objects.
    """
    are_parts = wholes != numbers
    lengths = np.hypot(motions[:, 0], motions[:, 1])
    is_possible = lengths > NOISE_M / USUAL_INTERVAL_S * interval_s
    is_possible &= lengths <= settings.max_speed_m_s * interval_s
    limit = np.log(settings.min_probability / (1 - settings.min_probability))
    may_move = is_possible & (scores > limit - _TENTATIVE)
    alone, best = are_parts & may_move, np.full(numbers.max(initial=0) + 1, -np.inf)
    np.maximum.at(best, wholes[alone], scores[alone])
    may_move &= are_parts | (scores >= best[numbers])
    may_move &= ~are_parts | ~np.isin(wholes, numbers[may_move])
    return may_move, may_move & (scores > limit)
