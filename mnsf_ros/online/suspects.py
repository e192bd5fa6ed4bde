# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Suspects: objects that other sweeps do not support as static."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import Bools
from mnsf_ros.core.reason import Verdict
from mnsf_ros.online.motions import judge
from mnsf_ros.online.object_points import NOISE_M
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.target import Targets

# Mean distance of a static object beyond the spacing of its points: twice the noise of the ranges.
_MAX_STATIC_M: Final = 2 * NOISE_M


def with_suspects(table: ObjectTable, targets: Targets, max_suspects: int) -> ObjectTable:
    """Rejects objects that other sweeps support as static, and those beyond the work limit.

    Fills `static` of the suspects.

    Args:
        table: The objects.
        targets: The other sweeps.
        max_suspects: Maximum number of suspects: those with a moving track, then the nearest.
    """
    is_suspect = _are_suspects(table, targets)
    table = table.rejected(np.flatnonzero(~is_suspect), Verdict.NOT_SUSPECTED)
    rows = np.flatnonzero(is_suspect)
    points = table.points.select(rows)
    no_motion = np.zeros((len(rows), 3), np.float32)
    table = table.put(rows, static=judge(points.thinner(), targets, no_motion))
    if len(rows) <= max_suspects:
        return table
    squared_ranges = (points.centers**2).sum(axis=1)
    order = np.lexsort((squared_ranges, table.prior.log_odds[rows] <= 0))
    return table.rejected(rows[order[max_suspects:]], Verdict.LEFT_OUT)


def _are_suspects(table: ObjectTable, targets: Targets) -> Bools:
    """Returns (K,) the objects that no older sweep supports as static, and those with a track.

    Without older sweeps, the neighbouring ones are used. One sweep is enough to support an object,
    because in others its surface may be hidden. Objects next to points that are gone are suspects,
    too: of a long side that slides along itself only the ends change.
    """
    some, others = table.points.thinner(), targets.past or targets.near
    has_track = table.prior.has_track
    is_unsupported = ~has_track
    # The oldest first: it decides most objects, and few remain for the other sweeps.
    for target in reversed(others):
        rows = np.flatnonzero(is_unsupported)
        residuals = target.residuals(some.select(rows), np.zeros((len(rows), 3), np.float32))
        is_unsupported[rows] = residuals > _MAX_STATIC_M
    near_gone = np.concatenate([target.objects_near_gone for target in others])
    return np.asarray(is_unsupported | has_track | np.isin(table.points.numbers, near_gone))
