# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The layers of a recorded sweep: its estimate, the truth, and the error of the estimate."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import TrackedObject
from mnsf_ros.evaluation.scoring import true_motion
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S
from mnsf_ros.view.estimated_sweeps import EstimatedSweep
from mnsf_ros.view.scene_message import Colors, Scene, error_colors, motion_colors


def scene_of(sweep: EstimatedSweep, layer: str) -> Scene:
    """Returns a sweep as it is drawn, in the colours of a layer: estimate, truth or error."""
    current = sweep.triplet.current
    return Scene(current.stamp_ns, current.xyz, _COLORS[layer](sweep), *pose_and_objects(sweep))


def pose_and_objects(
    sweep: EstimatedSweep,
) -> tuple[NDArray[np.float64], Sequence[TrackedObject]]:
    """Returns world_from_sensor (4, 4), the identity if unknown, and the dynamic objects."""
    known = sweep.estimate.over_ground
    return (np.eye(4), ()) if known is None else (known.world_from_sensor, known.objects)


def _estimate_colors(sweep: EstimatedSweep) -> Colors:
    estimate, known = sweep.estimate, sweep.estimate.over_ground
    motion = estimate.flow if known is None else known.motion
    dynamic = np.zeros(len(motion), np.bool_) if known is None else known.dynamic
    return motion_colors(motion / np.float32(sweep.triplet.interval_s or USUAL_INTERVAL_S), dynamic)


def _truth_colors(sweep: EstimatedSweep) -> Colors:
    example = sweep.example
    velocity = np.zeros_like(sweep.estimate.flow)
    moves: NDArray[np.bool_] = np.zeros(len(velocity), np.bool_)
    if (truth := example.truth) is not None and truth.valid.any():
        moves = truth.dynamic & truth.valid
        rows = np.flatnonzero(truth.valid)
        motion, _ = true_motion(example, truth, rows)
        velocity[rows] = motion.velocity
        velocity[~moves] = 0.0
    return motion_colors(velocity, moves)


def _colors_of_errors(sweep: EstimatedSweep) -> Colors:
    truth, flow = sweep.example.truth, sweep.estimate.flow
    if truth is None:
        return error_colors(flow[:, 0], np.zeros(len(flow), np.bool_))
    return error_colors(np.linalg.norm(flow - truth.flow, axis=1), truth.valid)


_COLORS: Final = {
    "estimate": _estimate_colors,
    "truth": _truth_colors,
    "error": _colors_of_errors,
}
LAYERS: Final = tuple(_COLORS)
