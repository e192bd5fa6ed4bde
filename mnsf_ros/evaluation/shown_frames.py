# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Frames for the animation of a report: what moves in truth and by a method, side by side."""

from __future__ import annotations

import io
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from mnsf_ros.core.flow_columns import FULL_COLOR_M_S
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.drawing.street_picture import street_picture
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# The first ones of a recording: some seconds at most, which a page can hold.
NUM_FRAMES: Final = 20
_SIZE_PX: Final = (560, 299)
_GAP_PX: Final = 4
_GAP_COLOR: Final = (90, 98, 110)
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
    """Draws all points of a sweep twice, by the truth if there is one and by the estimate."""
    current, truth, known = example.triplet.current, example.truth, estimate.over_ground
    interval_s = example.triplet.interval_s or USUAL_INTERVAL_S
    motions: list[NDArray[np.float32]] = []
    if truth is not None:
        own = _own_motion(example, np.where(truth.valid[:, None], truth.flow, np.float32(np.nan)))
        motions.append(np.where(truth.dynamic[:, None], own, np.float32(0.0)))
    motions.append(_own_motion(example, estimate.flow) if known is None else known.motion)
    width, height = _SIZE_PX
    frame = Image.new("RGB", (len(motions) * (width + _GAP_PX) - _GAP_PX, height), _GAP_COLOR)
    for place, motion in enumerate(motions):
        velocity = np.nan_to_num(motion / np.float32(interval_s)).astype(np.float32, copy=False)
        velocity[np.hypot(velocity[:, 0], velocity[:, 1]) < _SLOW_M_S] = 0.0
        picture = street_picture(current.xyz, velocity, [], FULL_COLOR_M_S)
        frame.paste(picture.resize(_SIZE_PX, Image.Resampling.BOX), (place * (width + _GAP_PX), 0))
    content = io.BytesIO()
    frame.save(content, "PNG")
    return ShownFrame(example.recording, method, example.number, content.getvalue())


def _own_motion(example: Example, flow: NDArray[np.float32]) -> NDArray[np.float32]:
    """The flow (N, 3) without ego motion, which is fitted to it if it is not known."""
    xyz, motion = example.triplet.current.xyz, example.triplet.next_from_current
    return residual_flow(xyz, flow, fit_rigid_motion(xyz, flow) if motion is None else motion)


def webp(frames: list[bytes], interval_s: float) -> bytes:
    """Returns an animation of PNG files that plays at an interval."""
    first, *others = (Image.open(io.BytesIO(frame)) for frame in frames)
    content = io.BytesIO()
    duration = max(1, round(1e3 * interval_s))
    first.save(
        content, "WEBP", save_all=True, append_images=others, duration=duration, loop=0, quality=60
    )
    return content.getvalue()
