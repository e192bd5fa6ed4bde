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

# Of what is faster, the box points where it goes; of what is slower, along its longest side.
_MIN_HEADING_M_S: Final = 1.0
_MAX_BOX_POINTS: Final = 1000
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
    told, seen_of, parts = [], [], []
    for track in tracks:
        start, end = np.searchsorted(ids, (track.track_id, track.track_id + 1))
        seen = moving[start:end]
        points = current.xyz[seen]
        if not len(seen):
            points = turned(track.points - place, turn.T).astype(np.float32)
        if len(seen) or _is_hidden(track, points, current):
            told.append(track)
            seen_of.append(seen)
            parts.append(points[:: -(-len(points) // _MAX_BOX_POINTS)])
    if not told:
        return ()
    velocities = turned(np.stack([track.velocity for track in told]), turn.T)
    covariances = np.kron(np.stack([track.covariance for track in told]), np.eye(3))
    places = _at_stamp(*_boxes(parts, velocities), velocities, seen_of, current)
    return tuple(
        TrackedObject(
            track_id=track.track_id,
            center=center,
            size=size,
            yaw=float(yaw),
            velocity=velocity,
            covariance=covariance,
            age_s=(track.stamp_ns - track.begun_ns) / NANOSECONDS,
            num_points=len(seen),
        )
        for track, seen, covariance, center, size, yaw, velocity in zip(
            told, seen_of, covariances, *places, strict=True
        )
    )


def _at_stamp(
    centers: NDArray[np.float64],
    sizes: NDArray[np.float64],
    yaws: NDArray[np.float64],
    velocities: NDArray[np.float64],
    seen: Sequence[NDArray[np.int64]],
    current: ObjectSweep,
) -> tuple[NDArray[np.float64], ...]:
    """Returns K boxes where they are at the stamp, in the frame of the sensor then.

    Args:
        centers: (K, 3) metres, when they were measured, in the frame of the moment of the sweep.
        sizes: (K, 3) metres.
        yaws: (K,) radians.
        velocities: (K, 3) metres per second.
        seen: The points that show each of them; none if it is hidden.
        current: The sweep.

    Returns:
        Centers, sizes, yaws and velocities.
    """
    motion, times_s = current.pose.motion, current.sweep.times_s
    if motion is None or times_s is None:
        return centers, sizes, yaws, velocities
    stamp_from_moment = np.asarray(np.linalg.inv(motion.moment_from_stamp), np.float64)
    turn, place = stamp_from_moment[:3, :3], stamp_from_moment[:3, 3]
    measured_s = np.array(
        [times_s[points].mean() if len(points) else motion.moment_s for points in seen]
    )
    at_stamp = turned(centers - measured_s[:, None] * velocities, turn) + place
    headings = np.stack([np.cos(yaws), np.sin(yaws), np.zeros_like(yaws)], axis=1)
    x, y, _ = turned(headings, turn).T
    return at_stamp, sizes, np.arctan2(y, x), turned(velocities, turn)


def _is_hidden(track: Track, points: NDArray[np.float32], current: ObjectSweep) -> bool:
    """Whether something occludes the points (P, 3) where a track is expected."""
    if track.num_seen < _MIN_SEEN or len(points) == 0:
        return False
    return 2 * np.count_nonzero(current.view.are_hidden(points)) > len(points)


def _boxes(
    parts: Sequence[NDArray[np.float32]], velocities: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Returns the upright boxes around K > 0 sets of points, none of them empty.

    Args:
        parts: K sets of points (P, 3), metres.
        velocities: (K, 3) of each set.

    Returns:
        Centers (K, 3) and sizes (K, 3) in metres, and yaws (K,) in radians.
    """
    points = np.concatenate(parts).astype(np.float64)
    counts = np.array([len(part) for part in parts])
    starts, owners = np.cumsum(counts) - counts, np.repeat(np.arange(len(parts)), counts)
    middles = np.add.reduceat(points, starts, axis=0) / counts[:, None]
    x, y, z = (points - middles[owners]).T
    yaws = _headings(x, y, starts, velocities)
    cosines, sines = np.cos(yaws), np.sin(yaws)
    ahead = x * cosines[owners] + y * sines[owners]
    aside = y * cosines[owners] - x * sines[owners]
    along = np.stack([ahead, aside, z], axis=1)
    low, high = np.minimum.reduceat(along, starts), np.maximum.reduceat(along, starts)
    x, y, z = ((low + high) / 2).T
    shifts = np.stack([x * cosines - y * sines, x * sines + y * cosines, z], axis=1)
    return middles + shifts, high - low, yaws


def _headings(
    x: NDArray[np.float64],
    y: NDArray[np.float64],
    starts: NDArray[np.int64],
    velocities: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Returns (K,) where velocities point to, or of slow objects their longest direction.

    Args:
        x: (P,) metres, the places of points around the middle of their object.
        y: (P,) the same.
        starts: (K,) the first point of each object.
        velocities: (K, 3) of each object.
    """
    across, along = np.add.reduceat(x * y, starts), np.add.reduceat(x * x - y * y, starts)
    longest = np.arctan2(2 * across, along) / 2
    cosines, sines = np.cos(longest), np.sin(longest)
    is_backward = velocities[:, 0] * cosines + velocities[:, 1] * sines < 0
    longest = np.where(is_backward, np.arctan2(-sines, -cosines), longest)
    is_fast = np.hypot(velocities[:, 0], velocities[:, 1]) > _MIN_HEADING_M_S
    return np.where(is_fast, np.arctan2(velocities[:, 1], velocities[:, 0]), longest)
