# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flows that a report shows, kept while a run goes on, so that pictures show what was scored.

Of each method these are the worst ones, and the surroundings of the movers that it missed in most
sweeps.
"""

from __future__ import annotations

import hashlib
import heapq
import io
import math
from collections.abc import Collection
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from mnsf_ros.evaluation.examples import Example
from mnsf_ros.evaluation.flow_recording import folder_name, recorded_flow
from mnsf_ros.evaluation.metrics import end_point_errors
from mnsf_ros.evaluation.movers import ObjectRow
from mnsf_ros.evaluation.options import TaskKey
from mnsf_ros.evaluation.results import ResultRow
from mnsf_ros.geometry.rigid_motion import fit_rigid_motion
from mnsf_ros.sweeps_io.files import UNREADABLE, open_npz

# Parts of the folder of a run: the flows that are shown, and the recordings of all flow.
PICTURES_FOLDER: Final = "pictures"
FLOW_FOLDER: Final = "flow"
# The surroundings of a mover reach so far to each side.
_AROUND_M: Final = 12.0


@dataclass(frozen=True, eq=False)
class ShownFlow:
    """The flow of the N scored points of a sweep, or of those around a mover that was missed.

    Attributes:
        recording: Name of the recording.
        method: Name of the method.
        number: Index of the sweep in the recording.
        xyz: (N, 3) metres, sensor frame.
        flow: (N, 3) metres until the next sweep; rows that are not finite have none.
        error_m: (N,) distance to the true flow, or without truth that of the moved points to the
            next sweep; NaN where unknown.
        truth: (N, 3) true flow, NaN where unknown; None if there is none at all.
        ego_motion: (4, 4) next_from_current; None if nobody knows.
        mover: Number of the missed mover in the truth; None of a whole sweep.
        rank: Those of the highest rank are shown: mean error of the sweep in metres, or number of
            sweeps in which the mover was missed.
    """

    recording: str
    method: str
    number: int
    xyz: NDArray[np.float32]
    flow: NDArray[np.float32]
    error_m: NDArray[np.float32]
    truth: NDArray[np.float32] | None = None
    ego_motion: NDArray[np.float64] | None = None
    mover: int | None = None
    rank: float = 0.0


class ShownFlowChooser:
    """Chooses the flows of one task that a report would show if the run ended now."""

    def __init__(self, number: int) -> None:
        """Chooses so many of the worst sweeps, and of the missed movers."""
        self._number = number
        self._largest_m: list[float] = []
        self._new: list[ShownFlow] = []
        # Each missed mover with most points; `rank` counts its sweeps.
        self._missed: dict[int, tuple[int, ShownFlow]] = {}

    def look(self, row: ResultRow, example: Example, flow: NDArray[np.float32]) -> None:
        """Looks at the flow (M, 3) of all points of an example, and at what it was scored."""
        if self._number == 0:
            return
        is_worst = self._is_among_the_worst(row.badness_m)
        if not is_worst and not row.missed_movers:
            return
        shown = _shown(row, example, flow)
        if is_worst:
            self._new.append(shown)
        for item in row.missed_movers:
            most, known = self._missed.get(item.object_id, (0, None))
            num_sweeps = 1 if known is None else known.rank + 1
            if known is None or item.num_points > most:
                most, known = item.num_points, _around(item, shown)
            self._missed[item.object_id] = most, replace(known, rank=num_sweeps)

    def _is_among_the_worst(self, badness_m: float) -> bool:
        """Whether an error is one of the largest so far; it is remembered."""
        if math.isnan(badness_m):
            return False
        heapq.heappush(self._largest_m, badness_m)
        is_full = len(self._largest_m) > self._number
        return not is_full or heapq.heappop(self._largest_m) < badness_m

    def new(self) -> list[ShownFlow]:
        """Gives out the sweeps that are among the worst so far, since the last time."""
        found, self._new = self._new, []
        return found

    def missed(self) -> list[ShownFlow]:
        """Returns the surroundings of the movers that were missed in most sweeps."""
        found = (flow for _, flow in self._missed.values())
        return heapq.nlargest(self._number, found, key=lambda one: one.rank)


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
        rank=row.badness_m,
    )


def _distances(moved: NDArray[np.float32], following: NDArray[np.float32]) -> NDArray[np.float64]:
    """The distance (N,) of each moved point (N, 3) to the next sweep (M, 3); NaN if unknown."""
    distances_m, finite = np.full(len(moved), np.nan), np.isfinite(moved).all(axis=1)
    if len(following):
        distances_m[finite], _ = cKDTree(following).query(moved[finite])
    return distances_m


def _around(item: ObjectRow, sweep: ShownFlow) -> ShownFlow:
    """The part of a sweep around a mover."""
    near = (np.abs(sweep.xyz[:, :2] - item.place_m) <= _AROUND_M).all(axis=1)
    motion, truth = sweep.ego_motion, sweep.truth
    if motion is None and truth is not None:
        # The surroundings alone may be little more than the mover.
        motion = fit_rigid_motion(sweep.xyz, truth)
    return replace(
        sweep,
        xyz=sweep.xyz[near],
        flow=sweep.flow[near],
        error_m=sweep.error_m[near],
        truth=None if truth is None else truth[near],
        ego_motion=motion,
        mover=item.object_id,
    )


class ShownFlows:
    """The flows of a run that a report shows: of each method so many, as files in a folder."""

    def __init__(self, run_folder: Path) -> None:
        self._folder = run_folder / PICTURES_FOLDER
        self._recordings = run_folder / FLOW_FOLDER

    @cached_property
    def _known(self) -> dict[Path, ShownFlow]:
        """The flows that are there, without their points."""
        found = ((path, _read(path)) for path in sorted(self._folder.glob("*.npz")))
        return {path: _without_points(flow) for path, flow in found if flow is not None}

    def find(self, row: ResultRow, mover: int | None = None) -> ShownFlow | None:
        """Returns the flow of a row, or around a mover; None if it was not kept, or is damaged."""
        found = _read(self._path(row.recording, row.method, row.number, mover))
        if found is None:
            path = self._recordings / folder_name(row.recording, row.method)
            recorded = recorded_flow(path, row.stamp_ns)
            if recorded is not None:
                return ShownFlow(row.recording, row.method, row.number, *recorded)
        return found

    def add(self, flow: ShownFlow, number: int) -> None:
        """Keeps a flow, and takes away what is not among the worst of its method any more.

        These are so many sweeps, and so many missed movers.

        Raises:
            OSError: It cannot be written.
        """
        path = self._path(flow.recording, flow.method, flow.number, flow.mover)
        values = {one.name: getattr(flow, one.name) for one in fields(flow)}
        content = io.BytesIO()
        np.savez(content, **{name: x for name, x in values.items() if x is not None})
        known, draft = self._known, path.with_name(".new")
        self._folder.mkdir(exist_ok=True)
        draft.write_bytes(content.getbuffer())
        draft.replace(path)
        known[path] = _without_points(flow)
        rivals = [
            path
            for path, one in known.items()
            if one.method == flow.method and (one.mover is None) == (flow.mover is None)
        ]
        kept = heapq.nlargest(number, rivals, key=lambda path: known[path].rank)
        self._remove(set(rivals).difference(kept))

    def drop(self, keys: Collection[TaskKey]) -> None:
        """Takes the flows of some tasks away."""
        self._remove({p for p, one in self._known.items() if (one.recording, one.method) in keys})

    def _remove(self, paths: Collection[Path]) -> None:
        for path in paths:
            path.unlink(missing_ok=True)
            del self._known[path]

    def _path(self, recording: str, method: str, number: int, mover: int | None) -> Path:
        task, end = folder_name(recording, method), "" if mover is None else f".{mover}"
        # Not every locale can write every name.
        task = task if task.isascii() else hashlib.sha256(task.encode()).hexdigest()[:16]
        return self._folder / f"{task}.{number}{end}.npz"


def _without_points(flow: ShownFlow) -> ShownFlow:
    none = np.zeros((0, 3), np.float32)
    return replace(flow, xyz=none, flow=none, error_m=none[:, 0], truth=None)


def _read(path: Path) -> ShownFlow | None:
    try:
        with open_npz(path) as archive:
            arrays = dict(archive)
        values: dict[str, Any] = {name: x if x.ndim else x.item() for name, x in arrays.items()}
        found = ShownFlow(**values)
        sizes = {
            len(x) for x in (found.xyz, found.flow, found.error_m, found.truth) if x is not None
        }
    except UNREADABLE:
        return None
    return found if len(sizes) == 1 else None
