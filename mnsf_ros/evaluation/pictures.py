# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures for the report, drawn by tasks: the worst sweeps, and an animation of the first."""

import hashlib
import heapq
import math
import re
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import partial
from typing import Final

import numpy as np

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.drawing.color_wheel import FULL_COLOR_M_S
from mnsf_ros.drawing.street_picture import animation, frame
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.outcomes import attempted
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow
from mnsf_ros.sweeps.sweep import NANOSECONDS, USUAL_INTERVAL_S

ANIMATION: Final = "animation.webp"
# Frames of the animation: some seconds at most, which a page can hold.
_NUM_FRAMES: Final = 20
# Slower points are grey: networks leave some motion on static points.
_SLOW_M_S: Final = 0.5


@dataclass(frozen=True)
class Picture:
    """A picture of a task."""

    file: str  # in the folder of the run, see `picture_file`
    image: bytes


def worst_name(number: int) -> str:
    """Returns the name of the picture of a sweep by its number."""
    return f"sweep_{number}.png"


def picture_file(recording: str, method: str, name: str) -> str:
    """Returns the path of a picture, `ANIMATION` or `worst_name`, in the folder of a run."""
    # The name of the folder is valid in every file system and locale, and unique to the task.
    plain = f"{recording}.{method}"
    safe = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).strip("._")[:100]
    if safe != plain:
        safe = f"{safe}.{hashlib.sha256(plain.encode()).hexdigest()[:8]}"
    return f"pictures/{safe}/{name}"


class Painter:
    """Draws the first sweeps of a task as an animation, and its worst ones."""

    def __init__(self, number: int, *, is_animated: bool = True) -> None:
        """Draws `number` of the worst sweeps; if any, also the animation."""
        self._number = number
        self._num_left = _NUM_FRAMES if number and is_animated else 0
        # Stamp in nanoseconds to frame.
        self._frames: dict[int, bytes] = {}
        self._worst: list[tuple[float, int, Example, FlowEstimate]] = []

    def add(self, badness_m: float, example: Example, estimate: FlowEstimate) -> None:
        """Takes an estimate with its badness, see `ResultRow`."""
        if self._number and not math.isnan(badness_m):
            # Of equally bad ones the first, as in the report.
            heapq.heappush(self._worst, (badness_m, -example.number, example, estimate))
            if len(self._worst) > self._number:
                heapq.heappop(self._worst)
        if self._num_left:
            self._num_left -= 1
            if (image := _drawn(lambda: sweep_picture(example, estimate))) is not None:
                self._frames[example.triplet.current.stamp_ns] = image

    def pictures(self, recording: str, method: str) -> Iterator[Picture]:
        """Yields the pictures that can be drawn."""
        images = {}
        if len(self._frames) > 1:
            interval_s = float(np.median(np.diff(list(self._frames)))) / NANOSECONDS
            frames = list(self._frames.values())
            images[ANIMATION] = _drawn(lambda: animation(frames, interval_s))
        for _, _, example, estimate in self._worst:
            draw = partial(sweep_picture, example, estimate, with_errors=True)
            images[worst_name(example.number)] = _drawn(draw)
        for name, image in images.items():
            if image is not None:
                yield Picture(picture_file(recording, method, name), image)


def _drawn(draw: Callable[[], bytes]) -> bytes | None:
    image = attempted(draw)
    return image if isinstance(image, bytes) else None


def sweep_picture(example: Example, estimate: FlowEstimate, *, with_errors: bool = False) -> bytes:
    """Returns a PNG file of a sweep, coloured by the truth, if there is one, and by the estimate.

    `with_errors` adds the errors from above, if there is truth.
    """
    truth, known = example.truth, estimate.over_ground
    interval_s = np.float32(example.triplet.interval_s or USUAL_INTERVAL_S)
    motions: list[Floats32] = []
    if truth is not None:
        own = _own_motion(example, np.where(truth.valid[:, None], truth.flow, np.float32(np.nan)))
        motions.append(np.where(truth.dynamic[:, None], own, np.float32(0.0)))
    motions.append(_own_motion(example, estimate.flow) if known is None else known.motion)
    velocities = [_without_slow(motion / interval_s) for motion in motions]
    errors_m = None
    if truth is not None and with_errors:
        errors_m = np.linalg.norm(estimate.flow - truth.flow, axis=1)
        errors_m[~truth.valid] = np.nan
    return frame(example.triplet.current.xyz, velocities, FULL_COLOR_M_S, errors_m)


def _own_motion(example: Example, flow: Floats32) -> Floats32:
    """Flow (N, 3) without ego motion, which is fitted to the flow if unknown."""
    xyz, motion = example.triplet.current.xyz, example.triplet.next_from_current
    return residual_flow(xyz, flow, fit_rigid_motion(xyz, flow) if motion is None else motion)


def _without_slow(velocity: Floats32) -> Floats32:
    speeds_m_s = np.hypot(velocity[:, 0], velocity[:, 1])
    return np.where(speeds_m_s[:, None] >= _SLOW_M_S, velocity, np.float32(0.0))
