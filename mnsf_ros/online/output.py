# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Output: motions of objects, given to all points of the sweep, and the tracked objects."""

from collections.abc import Sequence
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats, Floats32, Ints, Ints32
from mnsf_ros.compiled import compiled
from mnsf_ros.core.flow_estimate import OverGround, TrackedObject
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.geometry.transforms import planar_pose, turned_yaw
from mnsf_ros.online.attachments import rows_of_movers
from mnsf_ros.online.confidence import doubtful_confidence, moving_confidence, static_confidence
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.tracker import Track
from mnsf_ros.online.turning import flow_by, with_offsets
from mnsf_ros.sweeps.sweep import NANOSECONDS

# (2, 16) from above: between two of them, less than 2 % of the radius is cut off.
_ANGLES: Final = np.arange(16) * (2 * np.pi / 16)
_DIRECTIONS: Final = np.stack([np.cos(_ANGLES), np.sin(_ANGLES)])


def to_points(scene: Scene, table: ObjectTable, tracks: Sequence[Track]) -> OverGround:
    """Returns motion, confidence and track of all points of the current sweep.

    Args:
        scene: The sweeps.
        table: Its objects.
        tracks: All tracks.
    """
    current, next_ = scene.current, scene.targets.next
    object_ids, movers = current.object_ids(), table.movers
    rows = rows_of_movers(scene, table, object_ids)
    is_dynamic = rows >= 0
    dynamic_rows = np.flatnonzero(is_dynamic)
    rows = rows[dynamic_rows]
    motion = np.zeros((len(object_ids), 3), np.float32)
    offsets = np.take(current.xyz, dynamic_rows, axis=0) - movers.points.centers[rows]
    motion[dynamic_rows] = flow_by(with_offsets(offsets), rows, movers.linear_motions)
    track_ids = np.zeros(len(object_ids), np.int32)
    track_ids[dynamic_rows] = movers.track_ids[rows]
    confidence = _static_confidence(current, object_ids, table.doubtful)
    of_movers = moving_confidence(movers.fitted, movers.log_odds, movers.residual_rise)
    confidence[dynamic_rows] = of_movers[rows]
    if next_.sweep.pose.lost:
        # Without the ego motion, no flow is known.
        confidence[:] = 0
    # The poses of sweeps are those of a moment within them; messages refer to the stamp.
    return OverGround(
        motion=motion,
        dynamic=is_dynamic,
        confidence=confidence,
        world_from_sensor=current.pose.world_from_stamp,
        next_from_current=next_.from_current,
        source=next_.sweep.pose.source.value,
        pose_covariance=current.pose.covariance,
        motion_covariance=next_.sweep.pose.step_covariance,
        objects=tracked_objects(tracks, current, track_ids),
        track_ids=track_ids,
        lost=next_.sweep.pose.lost,
    )


def flow_of(scene: Scene, over_ground: OverGround) -> Floats32:
    """Returns (N, 3) metres, the flow of all points: motion over ground plus ego motion.

    The own body stays where it is in the frame of the sensor.
    """
    current, next_ = scene.current, scene.targets.next.sweep
    xyz, times_s = current.input.xyz, current.input.times_s
    next_from_current = over_ground.next_from_current
    dynamic_rows = np.flatnonzero(over_ground.dynamic)
    object_motion = over_ground.motion[dynamic_rows]
    during_sweep, during_next = current.pose.motion, next_.pose.motion
    if times_s is None or during_sweep is None or during_next is None:
        # (R - I) p + t, not (R p + t) - p: far from the origin the difference would lose digits.
        flow = transformed(xyz, next_from_current - np.diag((1.0, 1.0, 1.0, 0.0)))
        flow[dynamic_rows] += turned(object_motion, next_from_current[:3, :3])
    else:
        # Each sweep has a motion of its own.
        there = transformed(current.xyz, next_from_current)
        flow = during_next.moved_back(there, times_s) - xyz
        moved_on = turned(object_motion, next_from_current[:3, :3])
        flow[dynamic_rows] += during_next.turned_back(moved_on, times_s[dynamic_rows])
    flow[current.own] = 0.0
    return flow


def _static_confidence(current: ObjectSweep, object_ids: Ints, doubtful: ObjectTable) -> Floats32:
    """Returns (N,) the confidence in the flow of points of objects (N,), if they are static."""
    confidence = static_confidence(current.xyz)
    doubts = np.full(current.num_objects, np.nan, np.float32)
    doubts[doubtful.points.numbers] = doubtful_confidence(doubtful.static)
    in_doubt = np.flatnonzero(~np.isnan(doubts)[object_ids])
    confidence[in_doubt] = doubts[object_ids[in_doubt]]
    return confidence


def tracked_objects(
    tracks: Sequence[Track], current: ObjectSweep, point_ids: Ints32
) -> tuple[TrackedObject, ...]:
    """Returns the objects that move, those seen and those hidden at present.

    Args:
        tracks: K tracks at the time of the current sweep.
        current: The sweep.
        point_ids: (N,) the number of the track that each of its points belongs to, 0 for none.
    """
    turn, place = current.pose.world_from_sensor[:3, :3], current.pose.world_from_sensor[:3, 3]
    during_sweep = current.pose.motion
    stamp_from_moment = np.eye(4)
    if during_sweep is not None:
        stamp_from_moment = np.asarray(np.linalg.inv(during_sweep.moment_from_stamp), np.float64)
    tracked = np.flatnonzero(point_ids > 0)
    tracked = tracked[np.argsort(point_ids[tracked], kind="stable")]
    ids = point_ids[tracked]
    found = []
    for track in tracks:
        seen = tracked[slice(*np.searchsorted(ids, (track.track_id, track.track_id + 1)))]
        points = np.take(current.xyz, seen, axis=0)
        if len(seen) == 0:
            points = turned(track.points - place, turn.T).astype(np.float32)
        if len(seen) or _is_hidden(track, points, current):
            found.append(_tracked_object(track, points, current, seen, stamp_from_moment))
    return tuple(found)


def _tracked_object(
    track: Track, points: Floats32, current: ObjectSweep, seen: Ints, stamp_from_moment: Floats
) -> TrackedObject:
    """A track at the stamp of the sweep, in the frame of the sensor then.

    Args:
        track: The track.
        points: (P, 3) metres, where its points are in one moment.
        current: The sweep.
        seen: Their rows in the sweep; none if it is hidden.
        stamp_from_moment: (4, 4) from the frame of the moment.
    """
    velocity = current.pose.world_from_sensor[:3, :3].T @ track.velocity
    box = _box(points, velocity)
    center, during_sweep, times_s = box[:3], current.pose.motion, current.input.times_s
    if during_sweep is not None and times_s is not None:
        # The points of a mover hold for the time at which they were measured.
        center = center - velocity * (times_s[seen].mean() if len(seen) else during_sweep.moment_s)
    turn = stamp_from_moment[:3, :3]
    return TrackedObject(
        track_id=track.track_id,
        center=turn @ center + stamp_from_moment[:3, 3],
        size=box[3:6],
        yaw=turned_yaw(turn, box[6]),
        velocity=turn @ velocity,
        turn_rate=track.turn_rate,
        covariance=(track.covariance[:, None, :, None] * np.eye(3)[:, None]).reshape(6, 6),
        age_s=(track.stamp_ns - track.moving_since_ns) / NANOSECONDS,
        num_points=len(seen),
        outline=_outline(points, box),
    )


def _is_hidden(track: Track, points: Floats32, current: ObjectSweep) -> bool:
    """Whether the object likely moves, and most of its predicted points (P, 3) are occluded."""
    return track.log_odds > 0 and 2 * np.count_nonzero(current.view.are_hidden(points)) > len(
        points
    )


def _outline(points: Floats32, box: Floats) -> Floats:
    """Returns (K, 2) metres, the outermost of the points (P, 3) in each direction, from a box."""
    inside = (points[:, :2] - box[:2]) @ planar_pose(0.0, 0.0, box[6])[:2, :2]
    outermost = (inside @ _DIRECTIONS).argmax(axis=0)
    return np.asarray(inside[outermost[outermost != np.roll(outermost, 1)]])


@compiled("float64[::1](float32[:, ::1], float64[::1])")
def _box(points: Floats32, velocity: Floats) -> Floats:
    """Returns the upright box (7,) around points (P, 3), P > 0: center and size, metres, and yaw.

    Its yaw is the direction of the velocity (3,), or the longest direction if that gives a smaller
    box: for slow objects the direction of the velocity is mostly noise.
    """
    middle = np.zeros(3)
    for row in range(len(points)):
        for axis in range(3):
            middle[axis] += points[row, axis] / len(points)
    twice_xy, xx_minus_yy = 0.0, 0.0
    for row in range(len(points)):
        x, y = points[row, 0] - middle[0], points[row, 1] - middle[1]
        twice_xy += 2 * x * y
        xx_minus_yy += x * x - y * y
    goes, longest = np.arctan2(velocity[1], velocity[0]), np.arctan2(twice_xy, xx_minus_yy) / 2
    if np.cos(longest - goes) < 0:
        longest += np.pi
    box = np.full(7, np.inf)
    low, high, place = np.empty(3), np.empty(3), np.empty(3)
    for yaw in (goes, longest):
        cosine, sine = np.cos(yaw), np.sin(yaw)
        low[:], high[:] = np.inf, -np.inf
        for row in range(len(points)):
            x, y = points[row, 0] - middle[0], points[row, 1] - middle[1]
            place[0], place[1] = cosine * x + sine * y, cosine * y - sine * x
            place[2] = points[row, 2] - middle[2]
            for axis in range(3):
                low[axis], high[axis] = min(low[axis], place[axis]), max(high[axis], place[axis])
        size = high - low
        if size[0] * size[1] < box[3] * box[4]:
            x, y, z = (low + high) / 2
            box[0], box[1] = middle[0] + cosine * x - sine * y, middle[1] + sine * x + cosine * y
            box[2], box[3:6], box[6] = middle[2] + z, size, yaw
    return box
