# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Output: motions of objects, given to all points of the sweep."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.core.flow_estimate import OverGround
from mnsf_ros.ego_motion.ego_motion import EgoSource
from mnsf_ros.geometry.point_grid import REACH_M, PointGrid
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.online.confidence import doubtful_confidence, moving_confidence, standing_confidence
from mnsf_ros.online.object_points import NOISE_M, ObjectPoints, spacing_of
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.scene import Scene
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.tracked_objects import tracked_objects
from mnsf_ros.online.tracks import Track
from mnsf_ros.online.turning import Heads, encoded, headed


def to_points(
    scene: Scene,
    table: ObjectTable,
    heads: Heads,
    tracks: Sequence[Track],
    ids: NDArray[np.int64],
) -> OverGround:
    """Returns motion, confidence and track of all points of the current sweep.

    Args:
        scene: The sweeps.
        table: Its objects, K of which move.
        heads: (K, 3, 3) motions and turns of these K.
        tracks: All tracks.
        ids: (K,) the numbers of the K objects' tracks.
    """
    current, next_ = scene.current, scene.targets.near[0]
    owners, movers, doubtful = current.objects(), table.movers, table.doubtful
    rows = _rows_of_movers(scene, movers, doubtful.points.numbers, owners)
    is_dynamic = rows >= 0
    own = np.flatnonzero(is_dynamic)
    rows = rows[own]
    motion = np.zeros((len(owners), 3), np.float32)
    track_ids = np.zeros(len(owners), np.int32)
    offsets = np.take(current.xyz, own, axis=0) - movers.points.centers[rows]
    motion[own], track_ids[own] = headed(encoded(offsets), rows, heads), ids[rows]
    confidence = _static_confidence(current, owners, doubtful)
    confidence[own] = moving_confidence(movers.moving, movers.scores, movers.residual_rise)[rows]
    source = next_.sweep.pose.source
    if source is EgoSource.CONSTANT_VELOCITY:
        # Without the ego motion, no flow is known.
        confidence[:] = 0
    return OverGround(
        motion=motion,
        dynamic=is_dynamic,
        confidence=confidence,
        world_from_sensor=current.pose.world_from_stamp,
        next_from_current=next_.from_current,
        source=source.value,
        pose_covariance=current.pose.covariance,
        motion_covariance=next_.sweep.pose.step_covariance,
        objects=tracked_objects(tracks, current, track_ids),
        track_ids=track_ids,
    )


def flow_of(current: ObjectSweep, over_ground: OverGround) -> NDArray[np.float32]:
    """Returns (N, 3) metres, the flow of all points: motion over ground plus ego motion."""
    sweep, pose = current.sweep, current.pose
    xyz, motion = sweep.xyz, over_ground.next_from_current
    # (R - I) p + t, not (R p + t) - p: far from the origin the difference would lose digits.
    flow = transformed(xyz, motion - np.diag((1.0, 1.0, 1.0, 0.0)))
    moving = np.flatnonzero(over_ground.dynamic)
    over_ground_motion = over_ground.motion[moving]
    if pose.motion is not None and sweep.times_s is not None:
        over_ground_motion = pose.motion.turned_back(over_ground_motion, sweep.times_s[moving])
    flow[moving] += turned(over_ground_motion, motion[:3, :3])
    return flow


def _rows_of_movers(
    scene: Scene,
    moving: ObjectTable,
    doubtful: NDArray[np.int64],
    owners: NDArray[np.int64],
) -> NDArray[np.int64]:
    """Returns (N,) the mover from 0 that each point, of an object (N,), moves with; -1 for none.

    Suspects that were not found to move, with these numbers, may be fragments of movers.
    """
    current, movers = scene.current, moving.points
    rows = movers.rows_of(current.num_objects)[owners]
    are_loose = current.counts < scene.settings.min_points
    are_loose[doubtful] = True
    # A static whole with a moving part is no fragment.
    are_loose[current.wholes[movers.numbers]] = False
    are_loose[0] = False
    beside, their_rows = attached(current, owners, movers, are_loose)
    rows[beside] = their_rows
    if current.clock is not None:
        velocities = moving.moving.motions[movers.owners] / np.float32(scene.usual_interval_s)
        again, their_rows = current.clock.owners_again(
            current.xyz, movers.positions, velocities, movers.owners
        )
        is_free = rows[again] < 0
        rows[again[is_free]] = their_rows[is_free]
    return rows


def _static_confidence(
    current: ObjectSweep, owners: NDArray[np.int64], doubtful: ObjectTable
) -> NDArray[np.float32]:
    """Returns (N,) the confidence in the flow of points of objects (N,), if they are static."""
    confidence = standing_confidence(current.xyz)
    doubts = np.full(current.num_objects, np.nan, np.float32)
    doubts[doubtful.points.numbers] = doubtful_confidence(doubtful.standing)
    in_doubt = np.flatnonzero(~np.isnan(doubts)[owners])
    confidence[in_doubt] = doubts[owners[in_doubt]]
    return confidence


def attached(
    current: ObjectSweep,
    owners: NDArray[np.int64],
    movers: ObjectPoints,
    is_loose: NDArray[np.bool_],
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Returns which points beside movers move with them.

    Args:
        current: The sweep.
        owners: (N,) the object of each point, see `ObjectSweep.objects`.
        movers: K objects that move.
        is_loose: (all objects of the sweep,) those that may be fragments: not known to be static.

    Returns:
        (M,) the points, none of the movers' own among them, and (M,) the row of the mover of each.
    """
    if len(movers) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    points, point_rows = movers.all_points(current)
    may_belong = is_loose[owners] | (current.heights > NOISE_M) & ~current.kept
    beside = _beside(points, current.xyz, may_belong)
    theirs, places = owners[beside], np.take(current.xyz, beside, axis=0)
    nearest = np.full(len(beside), -1)
    is_part = is_loose[theirs]
    nearest[is_part] = PointGrid(points).nearest(places[is_part])
    # Points taken for ground belong to a mover if their height above the ground exceeds their
    # horizontal distance to the mover.
    higher_m = current.heights[beside] - spacing_of(places) / 2
    is_low = ~is_part & (higher_m > 0)
    nearest[is_low] = _above(points, places[is_low], higher_m[is_low])
    # A fragment moves as a whole, or not at all.
    whole = np.bincount(owners[is_loose[owners]], minlength=current.num_objects)
    goes = 2 * np.bincount(theirs[nearest >= 0], minlength=current.num_objects) > whole
    is_attached = (nearest >= 0) & goes[theirs]
    return beside[is_attached], point_rows[nearest[is_attached]]


def _above(
    points: NDArray[np.float32], places: NDArray[np.float32], within_m: NDArray[np.floating[Any]]
) -> NDArray[np.int64]:
    """Returns (P,) the row of the point nearest to each place (P, 3) in the view from above.

    It is -1 if none is within (P,) metres. Height differences do not count: between beams a mover
    may have no points over any height.
    """
    on_ground = np.array([1, 1, 0], np.float32)
    nearest = PointGrid(points * on_ground).nearest(places * on_ground)
    distances = np.hypot(*(np.take(points, nearest, axis=0) - places)[:, :2].T)
    return np.where(distances < within_m, nearest, -1)


@compiled("int64[::1](float32[:, ::1], float32[:, ::1], boolean[::1])")
def _beside(
    points: NDArray[np.float32], places: NDArray[np.float32], wanted: NDArray[np.bool_]
) -> NDArray[np.int64]:
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
    is_beside = np.zeros((num_rows, num_columns), np.bool_)
    for row in range(len(points)):
        x, y = int((points[row, 0] - low_x) / REACH_M), int((points[row, 1] - low_y) / REACH_M)
        is_beside[x - 1 : x + 2, y - 1 : y + 2] = True
    found, number = np.empty(len(places), np.int64), 0
    for row in range(len(places)):
        x, y = (places[row, 0] - low_x) / REACH_M, (places[row, 1] - low_y) / REACH_M
        is_inside = (0 <= x < num_rows) & (0 <= y < num_columns)
        if wanted[row] and is_inside and is_beside[int(x), int(y)]:
            found[number] = row
            number += 1
    return found[:number].copy()
