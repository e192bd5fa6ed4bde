# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Tracked objects: box, velocity and age of each mover."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.geometry.rigid_motion import turned
from mnsf_ros.objects.object_sweep import ObjectSweep
from mnsf_ros.objects.tracks import Track
from mnsf_ros.sweeps.sweep import NANOSECONDS

# A track that was seen to move so often is told of while most of its points would be hidden.
_MIN_SEEN: Final = 3


def tracked_objects(
    tracks: Sequence[Track], current: ObjectSweep, point_ids: NDArray[np.int32]
) -> tuple[TrackedObject, ...]:
    """Returns the objects that move, those seen and those hidden at present.

    Args:
        tracks: K tracks at the time of the current sweep.
        current: The sweep.
        point_ids: (N,) the number of the track that each of its points belongs to, 0 for none.
    """
    turn, place = current.pose.world_from_sensor[:3, :3], current.pose.world_from_sensor[:3, 3]
    moving = np.flatnonzero(point_ids > 0)
    moving = moving[np.argsort(point_ids[moving], kind="stable")]
    ids = point_ids[moving]
    found = []
    for track in tracks:
        seen = moving[slice(*np.searchsorted(ids, (track.track_id, track.track_id + 1)))]
        points = np.take(current.xyz, seen, axis=0)
        if len(seen) == 0:
            points = turned(track.points - place, turn.T).astype(np.float32)
            if not _is_hidden(track, points, current):
                continue
        found.append(_told(track, points, seen, current))
    return tuple(found)


def _is_hidden(track: Track, points: NDArray[np.float32], current: ObjectSweep) -> bool:
    """Whether something occludes the points (P, 3) where a track is expected."""
    if track.num_seen < _MIN_SEEN or len(points) == 0:
        return False
    return 2 * np.count_nonzero(current.view.are_hidden(points)) > len(points)


def _told(
    track: Track, points: NDArray[np.float32], seen: NDArray[np.int64], current: ObjectSweep
) -> TrackedObject:
    """A track at the stamp of the sweep, in the frame of the sensor then.

    Its points (P, 3), metres, P > 0, are those `seen` (P,), or else the expected ones.
    """
    velocity = current.pose.world_from_sensor[:3, :3].T @ track.velocity
    center, size, heading = _box(points.astype(np.float64), velocity)
    motion, times_s = current.pose.motion, current.sweep.times_s
    if motion is not None and times_s is not None:
        measured_s = times_s[seen].mean() if len(seen) else motion.moment_s
        stamp_from_moment = np.linalg.inv(motion.moment_from_stamp)
        center = stamp_from_moment[:3, :3] @ (center - measured_s * velocity)
        center += stamp_from_moment[:3, 3]
        velocity, heading = (stamp_from_moment[:3, :3] @ each for each in (velocity, heading))
    return TrackedObject(
        track_id=track.track_id,
        center=center,
        size=size,
        yaw=float(np.arctan2(heading[1], heading[0])),
        velocity=velocity,
        covariance=np.kron(track.covariance, np.eye(3)),
        age_s=(track.stamp_ns - track.begun_ns) / NANOSECONDS,
        num_points=len(seen),
    )


def _box(
    points: NDArray[np.float64], velocity: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """The upright box around points (P, 3), P > 0: center, size, and where its front points to.

    This is where it goes with its velocity (3,), or along its longest direction, if that makes the
    smaller box: of what is slow, the direction of the velocity is mostly noise.
    """
    middle = points.mean(axis=0)
    around = points - middle
    x, y, _ = around.T
    longest = np.arctan2(2 * (x * y).sum(), (x * x - y * y).sum()) / 2
    goes = np.arctan2(velocity[1], velocity[0])
    # Of the two ways along the longest direction the one that is nearer to where it goes.
    longest += np.pi * (np.cos(longest - goes) < 0)
    boxes = []
    for yaw in (goes, longest):
        axes = np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]])
        along = turned(around, axes)
        low, high = along.min(axis=0), along.max(axis=0)
        boxes.append((middle + axes.T @ ((low + high) / 2), high - low, axes[0]))
    return min(boxes, key=lambda box: box[1][0] * box[1][1])
