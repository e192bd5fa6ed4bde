# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pose of the points of a data set in the frame of its poses, from the flow of labels."""

from collections.abc import Iterable
from typing import Final

import numpy as np

from mnsf_ros.arrays import AnyFloats, Floats
from mnsf_ros.datasets.labelled_sweep import LabelledSweep
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion

# A fifth of the flow from which points are dynamic; poses of float32 are rounded to 1 mm in a city.
_SAME_MOTION_M: Final = 0.01
# Poses and flow that differ by more than this angle have other axes, and no common origin.
_SAME_TURN: Final = 1e-2
# Directions about which the vehicle hardly turns do not determine the origin.
_MIN_TURN_RATIO: Final = 0.1


def frame_of_points(pairs: Iterable[tuple[LabelledSweep, LabelledSweep]]) -> tuple[AnyFloats, str]:
    """Returns `frame_of_pose_from_points` (4, 4), and a note for the user if the frames differ.

    A vehicle that turns by R moves a lidar at t by (R - I) t more than its own origin. If the axes
    of both frames differ, the result is the identity, with a note. Pairs are sweeps with flow and
    pose, and their next sweeps.
    """
    turns, differences = [], []
    for current, following in pairs:
        if current.flow is None or current.pose is None or following.pose is None:
            continue
        by_pose = np.linalg.inv(following.pose) @ current.pose
        static = np.isfinite(current.flow).all(axis=1)
        static &= True if current.flow_valid is None else current.flow_valid
        static &= True if current.class_id is None else current.class_id == 0
        if not static.any():
            continue
        by_flow = fit_rigid_motion(current.xyz[static], current.flow[static])
        turns.append(by_pose[:3, :3] - np.eye(3))
        differences.append(by_flow - by_pose)
    result = np.eye(4)
    if not turns:
        return result, ""
    shifts = np.array(differences)[:, :3, 3]
    worst_m, worst_turn = _largest(shifts), np.abs(np.array(differences)[:, :3, :3]).max()
    if worst_m < _SAME_MOTION_M and worst_turn < _SAME_TURN:
        return result, ""
    origin, *_ = np.linalg.lstsq(np.concatenate(turns), shifts.ravel(), rcond=_MIN_TURN_RATIO)
    rest_m = _largest(shifts - np.array(turns) @ origin)
    if rest_m < _SAME_MOTION_M and worst_turn < _SAME_TURN:
        result[:3, 3] = origin
        x_m, y_m, _ = np.round(origin, 2) + 0.0
        return result, (
            f"'pose' is of another frame than the points: their origin is at {x_m}, {y_m} m in it "
            "(found by 'flow' at static points); poses are moved there"
        )
    return result, (
        f"'flow' at static points contradicts 'pose' by up to {worst_m:.2f} m and "
        f"{worst_turn:.3f} rad a sweep, expected below {_SAME_MOTION_M} m and {_SAME_TURN} rad; "
        "the flow is kept, dynamic points and poses may be wrong"
    )


def _largest(shifts: Floats) -> float:
    return float(np.linalg.norm(shifts, axis=1).max())
