# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Pictures for the report, drawn during the run: the first sweeps of a task, and its worst ones."""

from __future__ import annotations

import hashlib
import heapq
import math
import re
import shutil
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.drawing.color_wheel import FULL_COLOR_M_S
from mnsf_ros.drawing.example_pictures import example_picture
from mnsf_ros.drawing.side_by_side import frame
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.evaluation.options import TaskKey
from mnsf_ros.evaluation.outcomes import attempted
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion, residual_flow
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

PICTURES_FOLDER: Final = "pictures"
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
        badness_m: Figure that the worst sweeps are ranked by, see `ResultRow`; None for a frame of
            the animation.
    """

    recording: str
    method: str
    number: int
    image: bytes
    badness_m: float | None = None


class Painter:
    """Draws the first sweeps of one task as they come, and its worst ones at its end."""

    def __init__(self, number: int, *, has_frames: bool = True) -> None:
        """Draws so many of the worst sweeps; if any, also frames."""
        self._number = number
        self._num_frames = _NUM_FRAMES if number and has_frames else 0
        self._worst: list[tuple[float, int, ResultRow, Example, NDArray[np.float32]]] = []

    def frames(self, row: ResultRow, example: Example, estimate: FlowEstimate) -> Iterator[Picture]:
        """Yields the frame of an example, if it gets one; it may be among the worst, too."""
        if self._number and not math.isnan(row.badness_m):
            # Of equals the first ones, as in the report.
            item = (row.badness_m, -row.number, row, example, estimate.flow)
            heapq.heappush(self._worst, item)
            if len(self._worst) > self._number:
                heapq.heappop(self._worst)
        if self._num_frames:
            self._num_frames -= 1
            yield from _drawn(row, partial(_frame, example, estimate))

    def worst(self) -> Iterator[Picture]:
        """Yields the pictures of the worst sweeps, which take most of a second each."""
        for badness_m, _, row, example, flow in self._worst:
            yield from _drawn(row, partial(sweep_picture, row.method, example, flow), badness_m)


def _drawn(
    row: ResultRow, draw: Callable[[], bytes], badness_m: float | None = None
) -> Iterator[Picture]:
    """The picture of a row; none where it cannot be drawn, which must not cost results."""
    image = attempted(draw)
    if isinstance(image, bytes):
        yield Picture(row.recording, row.method, row.number, image, badness_m)


def _frame(example: Example, estimate: FlowEstimate) -> bytes:
    """All points of a sweep by the truth, if there is one, and by the estimate."""
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


def sweep_picture(name: str, example: Example, flow: NDArray[np.float32]) -> bytes:
    """Draws the flow (N, 3) of the scored points of a sweep, see `example_picture`."""
    rows = np.flatnonzero(example.scored)
    xyz, flow = example.triplet.current.xyz[rows], flow[rows]
    if example.truth is None:
        true_flow, error_m = None, _distances(xyz + flow, example.triplet.next.kept_xyz)
    else:
        truth = example.truth.of_points(rows)
        true_flow = np.where(truth.valid[:, None], truth.flow, np.float32(np.nan))
        error_m = end_point_errors(flow, true_flow)
    motion = example.triplet.next_from_current
    return example_picture(name, xyz, flow, error_m, true_flow, motion)


def _distances(moved: NDArray[np.float32], following: NDArray[np.float32]) -> NDArray[np.float64]:
    """The distance (N,) of each moved point (N, 3) to the next sweep (M, 3); NaN if unknown."""
    distances_m, finite = np.full(len(moved), np.nan), np.isfinite(moved).all(axis=1)
    if len(following):
        distances_m[finite], _ = cKDTree(following).query(moved[finite])
    return distances_m


class Pictures:
    """The pictures of a run as files: a folder for each task."""

    def __init__(self, run_folder: Path) -> None:
        self._folder = run_folder / PICTURES_FOLDER

    def find(self, row: ResultRow) -> bytes | None:
        """Returns the picture of a row; None if it is not among the worst."""
        files = self._files(row.recording, row.method, f"worst_*_{row.number}.png")
        return next((file.read_bytes() for file in files), None)

    def frames(self, recording: str, method: str) -> dict[int, bytes]:
        """Returns number of the sweep to frame of the animation, in the order of the sweeps."""
        files = self._files(recording, method, "frame_*.png")
        return {int(file.stem.split("_")[-1]): file.read_bytes() for file in files}

    def _files(self, recording: str, method: str, pattern: str) -> list[Path]:
        files = (self._folder / _folder_name(recording, method)).glob(pattern)
        return sorted(filter(Path.is_file, files), key=lambda file: (len(file.name), file.name))

    def add(self, picture: Picture, number: int) -> None:
        """Keeps a picture, and of each task so many of the worst sweeps.

        Raises:
            OSError: It cannot be written.
        """
        folder = self._folder / _folder_name(picture.recording, picture.method)
        folder.mkdir(parents=True, exist_ok=True)
        kind = "frame" if picture.badness_m is None else f"worst_{picture.badness_m!r}"
        draft = folder / ".new"
        draft.write_bytes(picture.image)
        draft.replace(folder / f"{kind}_{picture.number}.png")
        worst = self._files(picture.recording, picture.method, "worst_*.png")
        for file in sorted(worst, key=lambda file: -float(file.stem.split("_")[1]))[number:]:
            file.unlink()

    def drop(self, keys: Collection[TaskKey]) -> None:
        """Removes the pictures of some tasks."""
        for key in keys:
            shutil.rmtree(self._folder / _folder_name(*key), ignore_errors=True)


def _folder_name(recording: str, method: str) -> str:
    """A name for the folder of a task that any file system and locale can have."""
    plain = f"{recording}.{method}"
    safe = re.sub(r"[^A-Za-z0-9_.-]+", "_", plain).strip("._")[:100]
    # Two tasks must not share a name.
    return safe if safe == plain else f"{safe}.{hashlib.sha256(plain.encode()).hexdigest()[:8]}"
