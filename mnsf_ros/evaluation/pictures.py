# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures for the report, drawn during the run: the first sweeps of a task, and its worst ones."""

from __future__ import annotations

import hashlib
import heapq
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.drawing.color_wheel import FULL_COLOR_M_S
from mnsf_ros.drawing.street_picture import frame
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.outcomes import attempted
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

FRAME: Final = "frame"
WORST: Final = "worst"
_FOLDER: Final = "pictures"
# Frames of the animation: some seconds at most, which a page can hold.
_NUM_FRAMES: Final = 20
# Slower points are grey, as what networks leave of the static world.
_SLOW_M_S: Final = 0.5


@dataclass(frozen=True)
class Picture:
    """A picture of one sweep.

    Attributes:
        recording: Name of the recording.
        method: Name of the method.
        number: Index of the sweep in the recording.
        image: A PNG file.
        kind: `FRAME` of the animation, or one of the `WORST` sweeps.
    """

    recording: str
    method: str
    number: int
    image: bytes
    kind: str = FRAME


class Painter:
    """Draws the first sweeps of one task as they come, and its worst ones at its end."""

    def __init__(self, number: int, *, has_frames: bool = True) -> None:
        """Draws so many of the worst sweeps; if any, also frames."""
        self._number = number
        self._num_frames = _NUM_FRAMES if number and has_frames else 0
        self._worst: list[tuple[float, int, ResultRow, Example, FlowEstimate]] = []

    def frames(self, row: ResultRow, example: Example, estimate: FlowEstimate) -> Iterator[Picture]:
        """Yields the frame of an example, if it gets one; it may be among the worst, too."""
        if self._number and not math.isnan(row.badness_m):
            # Of equals the first ones, as in the report.
            heapq.heappush(self._worst, (row.badness_m, -row.number, row, example, estimate))
            if len(self._worst) > self._number:
                heapq.heappop(self._worst)
        if self._num_frames:
            self._num_frames -= 1
            yield from _drawn(FRAME, row, example, estimate)

    def worst(self) -> Iterator[Picture]:
        """Yields the pictures of the worst sweeps."""
        for _, _, row, example, estimate in self._worst:
            yield from _drawn(WORST, row, example, estimate)


def _drawn(
    kind: str, row: ResultRow, example: Example, estimate: FlowEstimate
) -> Iterator[Picture]:
    """The picture of a row; none where it cannot be drawn, which must not cost results."""
    image = attempted(lambda: sweep_picture(example, estimate))
    if isinstance(image, bytes):
        yield Picture(row.recording, row.method, row.number, image, kind)


def sweep_picture(example: Example, estimate: FlowEstimate) -> bytes:
    """Returns all points of a sweep by the truth, if there is one, and by the estimate, as PNG."""
    truth, known = example.truth, estimate.over_ground
    interval_s = np.float32(example.triplet.interval_s or USUAL_INTERVAL_S)
    motions: list[NDArray[np.float32]] = []
    if truth is not None:
        own = _own_motion(example, np.where(truth.valid[:, None], truth.flow, np.float32(np.nan)))
        motions.append(np.where(truth.dynamic[:, None], own, np.float32(0.0)))
    motions.append(_own_motion(example, estimate.flow) if known is None else known.motion)
    velocities = [_without_slow(motion / interval_s) for motion in motions]
    return frame(example.triplet.current.xyz, velocities, FULL_COLOR_M_S)


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


def save_picture(run_folder: Path, picture: Picture) -> None:
    """Writes a picture into the folder of its task.

    Raises:
        OSError: It cannot be written.
    """
    folder = _folder_of(run_folder, picture.recording, picture.method)
    folder.mkdir(parents=True, exist_ok=True)
    draft = folder / ".new"
    draft.write_bytes(picture.image)
    draft.replace(folder / f"{picture.kind}_{picture.number}.png")


def saved_pictures(run_folder: Path, recording: str, method: str, kind: str) -> dict[int, bytes]:
    """Returns number of the sweep to picture, in the order of the sweeps."""
    files = _folder_of(run_folder, recording, method).glob(f"{kind}_*.png")
    found = {int(file.stem.partition("_")[2]): file for file in files if file.is_file()}
    return {number: found[number].read_bytes() for number in sorted(found)}


def _folder_of(run_folder: Path, recording: str, method: str) -> Path:
    """The folder of a task, with a name that any file system and locale can have."""
    plain = f"{recording}.{method}"
    safe = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).strip("._")[:100]
    # Two tasks must not share a name.
    if safe != plain:
        safe = f"{safe}.{hashlib.sha256(plain.encode()).hexdigest()[:8]}"
    return run_folder / _FOLDER / safe
