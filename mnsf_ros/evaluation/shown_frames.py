# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Frames for the animation of a report: what moves in truth and by a method, side by side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_columns import FULL_COLOR_M_S
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.drawing.side_by_side import frame
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# The first ones of a recording: some seconds at most, which a page can hold.
NUM_FRAMES: Final = 20
# Slower points are grey, as what networks leave of the static world.
_SLOW_M_S: Final = 0.5


@dataclass(frozen=True)
class ShownFrame:
    """A frame of a method on a recording.

    Attributes:
        recording: Name of the recording.
        method: Name of the method.
        number: Index of the sweep in the recording.
        image: A PNG file.
    """

    recording: str
    method: str
    number: int
    image: bytes


def shown_frame(example: Example, method: str, estimate: FlowEstimate) -> ShownFrame:
    """Draws all points of a sweep by the truth, if there is one, and by the estimate."""
    truth, known = example.truth, estimate.over_ground
    interval_s = np.float32(example.triplet.interval_s or USUAL_INTERVAL_S)
    motions: list[NDArray[np.float32]] = []
    if truth is not None:
        own = _own_motion(example, np.where(truth.valid[:, None], truth.flow, np.float32(np.nan)))
        motions.append(np.where(truth.dynamic[:, None], own, np.float32(0.0)))
    motions.append(_own_motion(example, estimate.flow) if known is None else known.motion)
    velocities = [_without_slow(motion / interval_s) for motion in motions]
    image = frame(example.triplet.current.xyz, velocities, FULL_COLOR_M_S)
    return ShownFrame(example.recording, method, example.number, image)


def _own_motion(example: Example, flow: NDArray[np.float32]) -> NDArray[np.float32]:
    """The flow (N, 3) without ego motion, which is fitted to it if it is not known."""
    xyz, motion = example.triplet.current.xyz, example.triplet.next_from_current
    return residual_flow(xyz, flow, fit_rigid_motion(xyz, flow) if motion is None else motion)


def _without_slow(velocity: NDArray[np.float32]) -> NDArray[np.float32]:
    speeds_m_s = np.hypot(velocity[:, 0], velocity[:, 1])
    moving: NDArray[np.float32] = np.where(
        speeds_m_s[:, None] >= _SLOW_M_S, velocity, np.float32(0.0)
    )
    return moving
