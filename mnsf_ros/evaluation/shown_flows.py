# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Flow of the worst sweeps, kept during the run for the pictures of the report."""

from __future__ import annotations

import heapq
import io
import math
import shutil
from collections.abc import Collection, Iterator
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.flow_recording import folder_name
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.evaluation.options import TaskKey
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.evaluation.shown_frames import NUM_FRAMES, ShownFrame, shown_frame
from mnsf_ros.sweeps_io.files import UNREADABLE, open_npz

# Parts of the folder of a run: flows for pictures, and recordings of all flow.
PICTURES_FOLDER: Final = "pictures"
FLOW_FOLDER: Final = "flow"


@dataclass(frozen=True, eq=False)
class ShownFlow:
    """The flow of the N scored points of a sweep.

    Attributes:
        recording: Name of the recording.
        method: Name of the method.
        number: Index of the sweep in the recording.
        xyz: (N, 3) metres, sensor frame.
        flow: (N, 3) metres until the next sweep; rows that are not finite have none.
        error_m: (N,) error of the flow, or without truth distance from the moved points to the next
            sweep; NaN where unknown.
        truth: (N, 3) true flow, NaN where unknown; None if there is none at all.
        ego_motion: (4, 4) next_from_current; None if unknown.
        badness_m: Figure that sweeps are ranked by, see `ResultRow`.
    """

    recording: str
    method: str
    number: int
    xyz: NDArray[np.float32]
    flow: NDArray[np.float32]
    error_m: NDArray[np.float32]
    truth: NDArray[np.float32] | None = None
    ego_motion: NDArray[np.float64] | None = None
    badness_m: float = 0.0


class ShownFlowChooser:
    """Chooses the worst sweeps of one task so far, and frames of its first ones."""

    def __init__(self, number: int, *, has_frames: bool = True) -> None:
        """Chooses so many of the worst sweeps; if any, also frames."""
        self._number = number
        self._num_frames = NUM_FRAMES if number and has_frames else 0
        self._largest_m: list[float] = []

    def chosen(
        self, row: ResultRow, example: Example, estimate: FlowEstimate
    ) -> Iterator[ShownFlow | ShownFrame]:
        """Yields a frame of an example, and its flow if it is among the worst by now."""
        if self._num_frames:
            self._num_frames -= 1
            yield shown_frame(example, row.method, estimate)
        if self._number == 0 or math.isnan(row.badness_m):
            return
        heapq.heappush(self._largest_m, row.badness_m)
        is_full = len(self._largest_m) > self._number
        if not is_full or heapq.heappop(self._largest_m) < row.badness_m:
            yield _shown(row, example, estimate.flow)


def _shown(row: ResultRow, example: Example, flow: NDArray[np.float32]) -> ShownFlow:
    rows = np.flatnonzero(example.scored)
    xyz, flow = example.triplet.current.xyz[rows], flow[rows]
    if example.truth is None:
        true_flow, error_m = None, _distances(xyz + flow, example.triplet.next.kept_xyz)
    else:
        truth = example.truth.of_points(rows)
        true_flow = np.where(truth.valid[:, None], truth.flow, np.float32(np.nan))
        error_m = end_point_errors(flow, true_flow)
    return ShownFlow(
        recording=row.recording,
        method=row.method,
        number=row.number,
        xyz=xyz,
        flow=flow,
        error_m=error_m.astype(np.float32),
        truth=true_flow,
        ego_motion=example.triplet.next_from_current,
        badness_m=row.badness_m,
    )


def _distances(moved: NDArray[np.float32], following: NDArray[np.float32]) -> NDArray[np.float64]:
    """The distance (N,) of each moved point (N, 3) to the next sweep (M, 3); NaN if unknown."""
    distances_m, finite = np.full(len(moved), np.nan), np.isfinite(moved).all(axis=1)
    if len(following):
        distances_m[finite], _ = cKDTree(following).query(moved[finite])
    return distances_m


class ShownFlows:
    """The flows of a run for pictures, as files: a folder for each task."""

    def __init__(self, run_folder: Path) -> None:
        self._folder = run_folder / PICTURES_FOLDER

    def find(self, row: ResultRow) -> ShownFlow | None:
        """Returns the flow of a row; None if it was not kept, or is damaged."""
        return _read(self._folder / folder_name(row.recording, row.method) / f"{row.number}.npz")

    def frames(self, recording: str, method: str) -> dict[int, bytes]:
        """Returns number of the sweep to frame of an animation, in the order of the sweeps."""
        files = (self._folder / folder_name(recording, method)).glob("*.png")
        numbered = {int(file.stem): file for file in files}
        return {number: numbered[number].read_bytes() for number in sorted(numbered)}

    def add(self, shown: ShownFlow | ShownFrame, number: int) -> None:
        """Keeps frames and flows, of each task so many flows of the worst sweeps.

        Raises:
            OSError: It cannot be written.
        """
        folder = self._folder / folder_name(shown.recording, shown.method)
        folder.mkdir(parents=True, exist_ok=True)
        if isinstance(shown, ShownFrame):
            _write(folder / f"{shown.number}.png", shown.image)
            return
        values = {one.name: getattr(shown, one.name) for one in fields(shown)}
        content = io.BytesIO()
        np.savez(content, **{name: x for name, x in values.items() if x is not None})
        _write(folder / f"{shown.number}.npz", content.getvalue())
        flows = ((path, _read(path)) for path in folder.glob("*.npz"))
        ranks = {path: one.badness_m for path, one in flows if one is not None}
        for path in sorted(ranks, key=lambda path: -ranks[path])[number:]:
            path.unlink()

    def drop(self, keys: Collection[TaskKey]) -> None:
        """Removes the flows of some tasks."""
        for key in keys:
            shutil.rmtree(self._folder / folder_name(*key), ignore_errors=True)


def _write(path: Path, content: bytes) -> None:
    draft = path.with_name(".new")
    draft.write_bytes(content)
    draft.replace(path)


def _read(path: Path) -> ShownFlow | None:
    try:
        with open_npz(path) as archive:
            arrays = dict(archive)
        values: dict[str, Any] = {name: x if x.ndim else x.item() for name, x in arrays.items()}
        found = ShownFlow(**values)
        known = (found.xyz, found.flow, found.error_m, found.truth)
        sizes = {len(x) for x in known if x is not None}
    except UNREADABLE:
        return None
    return found if len(sizes) == 1 else None
