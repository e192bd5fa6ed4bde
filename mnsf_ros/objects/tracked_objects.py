"""What the tracks say of each object that moves: its box, velocity and age."""

from __future__ import annotations

from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.tracks import Tracks
from mnsf_ros.sweeps.sweep import NANOSECONDS

# Of what is faster, the box points where it goes; of what is slower, along its longest side.
_MIN_HEADING_M_S: Final = 1.0
_MAX_BOX_POINTS: Final = 1000
# A track that was seen to move so often is told of while it is hidden,
_MIN_SEEN: Final = 3
# that is, if more than this share of its points would be behind something.
_MIN_HIDDEN: Final = 0.5


def tracked_objects(
    tracks: Tracks, current: ObjectSweep, point_ids: NDArray[np.int32]
) -> tuple[TrackedObject, ...]:
    """Returns the objects that move, those seen and those hidden at present.

    Args:
        tracks: K tracks at the time of the current sweep.
        current: The sweep.
        point_ids: (N,) the number of the track that each of its points belongs to, 0 for none.
    """
    turn, place = current.pose.world_from_sensor[:3, :3], current.pose.world_from_sensor[:3, 3]
    velocities = turned(tracks.velocities, turn.T)
    expected = turned(tracks.points - place, turn.T).astype(np.float32)
    rows = np.flatnonzero(point_ids)
    rows = rows[np.argsort(point_ids[rows], kind="stable")]
    ids, starts = np.unique(point_ids[rows], return_index=True)
    parts = np.split(rows, starts[1:]) if len(ids) else []
    own = dict(zip(ids.tolist(), parts, strict=True))
    objects = []
    for row in range(len(tracks)):
        seen = own.get(int(tracks.ids[row]))
        points = expected[tracks.owners == row] if seen is None else current.xyz[seen]
        if seen is None and not _is_hidden(tracks, row, points, current):
            continue
        step = -(-len(points) // _MAX_BOX_POINTS)
        center, size, yaw = _box(points[::step].astype(np.float64), velocities[row])
        found = TrackedObject(
            track_id=int(tracks.ids[row]),
            center=center,
            size=size,
            yaw=yaw,
            velocity=velocities[row],
            covariance=np.kron(tracks.covariances[row], np.eye(3)),
            age_s=(tracks.stamp_ns - int(tracks.begun_ns[row])) / NANOSECONDS,
            num_points=0 if seen is None else len(seen),
        )
        objects.append(_at_stamp(found, current, seen))
    return tuple(objects)


def _at_stamp(
    found: TrackedObject, current: ObjectSweep, seen: NDArray[np.int64] | None
) -> TrackedObject:
    """Returns an object where it is at the stamp, in the frame of the sensor then.

    Args:
        found: Where it was when it was measured, in the frame of the moment of the sweep.
        current: The sweep.
        seen: The points that show it; None if it is hidden.
    """
    motion, times_s = current.pose.motion, current.sweep.times_s
    if motion is None or times_s is None:
        return found
    own_s = motion.moment_s if seen is None else float(times_s[seen].mean())
    stamp_from_moment = np.linalg.inv(motion.moment_from_stamp)
    turn, place = stamp_from_moment[:3, :3], stamp_from_moment[:3, 3]
    ahead = turn @ (np.cos(found.yaw), np.sin(found.yaw), 0.0)
    return replace(
        found,
        center=turn @ (found.center - own_s * found.velocity) + place,
        yaw=float(np.arctan2(ahead[1], ahead[0])),
        velocity=turn @ found.velocity,
    )


def _is_hidden(tracks: Tracks, row: int, points: NDArray[np.float32], current: ObjectSweep) -> bool:
    """Returns whether something is in front of the points (P, 3) where a track is expected."""
    if tracks.num_seen[row] < _MIN_SEEN:
        return False
    return bool(current.view.is_hidden(points).mean() > _MIN_HIDDEN)


def _box(
    points: NDArray[np.float64], velocity: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
    """Returns center and size in metres, and yaw in radians, of the upright box around points."""
    yaw = _heading(points, velocity)
    turn = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
    middle = points.mean(axis=0)
    along = turned(points - middle, turn)
    low, high = along.min(axis=0), along.max(axis=0)
    center = middle + turned((low + high)[None] / 2, turn.T)[0]
    return center, high - low, yaw


def _heading(points: NDArray[np.float64], velocity: NDArray[np.float64]) -> float:
    """Returns where the velocity points to, or of slow objects their longest direction."""
    if np.hypot(velocity[0], velocity[1]) > _MIN_HEADING_M_S:
        return float(np.arctan2(velocity[1], velocity[0]))
    x, y = (points[:, :2] - points[:, :2].mean(axis=0)).T
    yaw = float(np.arctan2(2 * (x * y).sum(), (x * x).sum() - (y * y).sum()) / 2)
    is_backward = velocity[0] * np.cos(yaw) + velocity[1] * np.sin(yaw) < 0
    return float(np.arctan2(-np.sin(yaw), -np.cos(yaw))) if is_backward else yaw
