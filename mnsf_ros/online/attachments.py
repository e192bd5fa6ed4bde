# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Attachments: points without a motion of their own that move with a mover."""

from typing import Final

import numpy as np

from mnsf_ros.arrays import AnyFloats, Bools, Floats32, Ints
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.online.object_points import NOISE_M, ObjectPoints, spacing_of
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.table import ObjectTable

# Lower points are ground: higher ones may be the bottom of a mover.
_MIN_HEIGHT_M: Final = NOISE_M


def rows_of_movers(scene: Scene, table: ObjectTable, object_ids: Ints) -> Ints:
    """Returns (N,) the row among the movers that each point moves with; -1 for none.

    Args:
        scene: The sweeps.
        table: The objects. Suspects that were not found to move may be fragments of movers.
        object_ids: (N,) the object of each point of the current sweep.
    """
    current, movers = scene.current, table.movers.points
    rows = movers.rows_of(current.num_objects)[object_ids]
    is_loose = current.counts < scene.settings.min_points
    is_loose[table.doubtful.points.numbers] = True
    # A static whole with a moving part is no fragment.
    is_loose[current.wholes[movers.numbers]] = False
    is_loose[0] = False
    attached_points, their_rows = attached(current, object_ids, movers, is_loose)
    rows[attached_points] = their_rows
    if current.clock is not None:
        motions = table.movers.fitted.motions[movers.owners]
        velocities = motions / np.float32(scene.usual_interval_s)
        again, their_rows = current.clock.owners_again(
            current.xyz, movers.positions, velocities, movers.owners
        )
        is_free = rows[again] < 0
        rows[again[is_free]] = their_rows[is_free]
    return rows


def attached(
    current: ObjectSweep, object_ids: Ints, movers: ObjectPoints, is_loose: Bools
) -> tuple[Ints, Ints]:
    """Returns which points near movers move with them.

    Args:
        current: The sweep.
        object_ids: (N,) the object of each point, see `ObjectSweep.object_ids`.
        movers: K objects that move.
        is_loose: (all objects of the sweep,) those that may be fragments of movers.

    Returns:
        (M,) the points, none of the movers' own among them, and (M,) the row of the mover of each.
    """
    if len(movers) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    points, owners = movers.all_points(current)
    may_belong = is_loose[object_ids] | (current.heights > _MIN_HEIGHT_M) & ~current.kept
    near = _near_from_above(points, current.xyz, may_belong)
    near_ids, places = object_ids[near], np.take(current.xyz, near, axis=0)
    nearest = np.full(len(near), -1)
    is_fragment = is_loose[near_ids]
    nearest[is_fragment] = PointGrid(points).nearest(places[is_fragment])
    # Points taken for ground belong to a mover if their height above the ground exceeds their
    # horizontal distance to the mover.
    higher_m = current.heights[near] - spacing_of(places) / 2
    is_low = ~is_fragment & (higher_m > 0)
    nearest[is_low] = _above(points, places[is_low], higher_m[is_low])
    # Either all points of a fragment move, or none. Ground, object 0, has size 0 here and always
    # passes.
    sizes = np.bincount(object_ids[is_loose[object_ids]], minlength=current.num_objects)
    num_near = np.bincount(near_ids[nearest >= 0], minlength=current.num_objects)
    is_attached = (nearest >= 0) & (2 * num_near > sizes)[near_ids]
    return near[is_attached], owners[nearest[is_attached]]


def _above(points: Floats32, places: Floats32, within_m: AnyFloats) -> Ints:
    """Returns (P,) the row of the point nearest to each place (P, 3) in the view from above.

    It is -1 if none is within (P,) metres. Height differences do not count: between beams a mover
    may have no points over any height.
    """
    on_ground = np.array([1, 1, 0], np.float32)
    nearest = PointGrid(points * on_ground).nearest(places * on_ground)
    distances = np.hypot(*(np.take(points, nearest, axis=0) - places)[:, :2].T)
    return np.where(distances < within_m, nearest, -1)


@compiled("int64[::1](float32[:, ::1], float32[:, ::1], boolean[::1])")
def _near_from_above(points: Floats32, places: Floats32, wanted: Bools) -> Ints:
    """Returns the rows of the wanted places (N, 3) that are near points (P, 3) as seen from above.

    Near is: in the cells of the points or in neighbouring cells, a little beyond the reach.
    """
    low_x, low_y, high_x, high_y = np.inf, np.inf, -np.inf, -np.inf
    for row in range(len(points)):
        low_x, high_x = min(low_x, points[row, 0]), max(high_x, points[row, 0])
        low_y, high_y = min(low_y, points[row, 1]), max(high_y, points[row, 1])
    low_x, low_y = low_x - REACH_M, low_y - REACH_M
    num_rows = int((high_x - low_x) / REACH_M) + 2
    num_columns = int((high_y - low_y) / REACH_M) + 2
    is_near = np.zeros((num_rows, num_columns), np.bool_)
    for row in range(len(points)):
        x, y = int((points[row, 0] - low_x) / REACH_M), int((points[row, 1] - low_y) / REACH_M)
        is_near[x - 1 : x + 2, y - 1 : y + 2] = True
    found, num_found = np.empty(len(places), np.int64), 0
    for row in range(len(places)):
        x, y = (places[row, 0] - low_x) / REACH_M, (places[row, 1] - low_y) / REACH_M
        is_inside = (0 <= x < num_rows) & (0 <= y < num_columns)
        if wanted[row] and is_inside and is_near[int(x), int(y)]:
            found[num_found] = row
            num_found += 1
    return found[:num_found].copy()
