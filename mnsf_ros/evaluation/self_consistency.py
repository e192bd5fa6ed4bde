"""What can be said of a flow without truth: whether its points land where the next sweep is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.sweeps.sweep import SweepTriplet


def landing_distances(
    triplet: SweepTriplet, flow: NDArray[np.float32], points: NDArray[np.bool_]
) -> dict[str, float]:
    """Measures how far from the next sweep the moved points are, and where they would be unmoved.

    Args:
        triplet: The sweeps.
        flow: (N, 3) metres per sweep, for the points of the current sweep.
        points: (N,) bool, the points to look at; their flow must be finite.

    Returns:
        `nearest_m` and, for zero flow, `zero_nearest_m`: means over the points of the distance to
        the nearest point of the next sweep. Empty if either sweep has no points.
    """
    if not points.any() or len(triplet.next) == 0:
        return {}
    tree = cKDTree(triplet.next.xyz)
    xyz = triplet.current.xyz[points]
    moved, _ = tree.query(xyz + flow[points])
    unmoved, _ = tree.query(xyz)
    return {"nearest_m": float(moved.mean()), "zero_nearest_m": float(unmoved.mean())}


def cycle_distance(
    triplet: SweepTriplet,
    flow: NDArray[np.float32],
    backward_flow: NDArray[np.float32],
    points: NDArray[np.bool_],
) -> dict[str, float]:
    """Measures how far from its start a point ends that goes to the next sweep and back.

    Args:
        triplet: The sweeps.
        flow: (N, 3) metres, from the current to the next sweep.
        backward_flow: (M, 3) metres, from the next sweep to the current one, for the points of
            the next sweep. A moved point takes that of the nearest one.
        points: (N,) bool, the points to look at; their flow must be finite.

    Returns:
        `cycle_m`, the mean over the points. Empty if either sweep has no points.
    """
    if not points.any() or len(triplet.next) == 0:
        return {}
    xyz = triplet.current.xyz[points]
    _, nearest = cKDTree(triplet.next.xyz).query(xyz + flow[points])
    way = flow[points] + backward_flow[nearest]
    return {"cycle_m": float(np.linalg.norm(way.astype(np.float64), axis=1).mean())}


def reversed_pair(triplet: SweepTriplet) -> SweepTriplet:
    """Returns the way back from the next to the current sweep, without a third sweep.

    Time goes on in it as on the way there, as methods that know time expect.
    """
    motion = triplet.next_from_current
    way_back = None if motion is None else np.asarray(np.linalg.inv(motion), dtype=np.float64)
    return SweepTriplet(
        previous=None,
        current=replace(triplet.next, stamp_ns=triplet.current.stamp_ns, odometry=None),
        next=replace(triplet.current, stamp_ns=triplet.next.stamp_ns, odometry=None),
        next_from_current=way_back,
    )
