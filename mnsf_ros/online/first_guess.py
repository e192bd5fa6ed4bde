# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The first guess: where the fit of an object's motion starts, and the vote on shifts."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats32, Ints
from mnsf_ros.compiled import compiled
from mnsf_ros.core.reason import Verdict
from mnsf_ros.geometry.point_sets import MAX_CELLS_PER_AXIS
from mnsf_ros.online.motions import JudgedMotions, best_of, fit_motion_field
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.target import Target, Targets

# In older sweeps, only motions within this of the best one in the neighbouring sweeps are tried:
# the work grows with the square.
_MAX_CHANGE_M_S: Final = 12.0
_CELL_M: Final = 0.4
# Limits the work, which else grows with the square of the interval: a slow sensor has larger cells.
_MAX_CELLS_OF_MARGIN: Final = 64
# Levels of height around the middle of the points, one bit each. The lowest and highest stay empty.
_NUM_LEVELS: Final = 16
# A motion explains an object clearly better if it leaves less than this share of the residual.
_CLEARLY_SHARE: Final = 0.8


def with_first_guesses(table: ObjectTable, scene: Scene) -> ObjectTable:
    """Fills `first_guess` of suspects, and rejects those that no motion explains clearly better.

    First the candidates are no motion, the shift with most votes in the neighbouring sweeps, and
    the track's prediction. Then the older sweeps vote on shifts around the best of these. They help
    with slow objects, and with long ones whose sides look the same everywhere.

    Args:
        table: All objects.
        scene: The sweeps.
    """
    suspects = table.select(table.open_rows)
    if len(suspects) == 0:
        return table
    some, prior, best = suspects.points.thinner(), suspects.prior, suspects.static
    targets, interval_s = scene.targets, scene.usual_interval_s
    reach_m, changed_m = scene.settings.max_speed_m_s * interval_s, _MAX_CHANGE_M_S * interval_s
    voted = voted_motions(some, targets.near, reach_m, best.motions)
    best = best_of(some, targets, best, prior.candidates(voted), prior)
    if targets.past:
        voted = voted_motions(some, targets.past, changed_m, best.motions)
        best = best_of(some, targets, best, [voted], prior)
    return with_better_guesses(table, best, targets)


def with_better_guesses(table: ObjectTable, judged: JudgedMotions, targets: Targets) -> ObjectTable:
    """Fills `first_guess` of K open objects, and rejects those that it does not explain better.

    It must explain an object clearly better than no motion does, or the object must have a track.
    Without older sweeps all objects are kept: the neighbouring sweeps cannot decide.

    Args:
        table: All objects.
        judged: Motions of the K objects.
        targets: The other sweeps.
    """
    rows = table.open_rows
    explains = judged.total < _CLEARLY_SHARE * table.static.total[rows]
    is_kept = table.prior.has_track[rows] | explains | (not targets.past)
    table = table.put(rows, first_guess=judged.motions)
    return table.rejected(rows[~is_kept], Verdict.NO_BETTER_MOTION)


def voted_motions(
    objects: ObjectPoints, targets: Sequence[Target], max_change_m: float, base: Floats32
) -> Floats32:
    """Returns (K, 3) metres, the shifts to the next sweep with most votes, fitted to a target.

    A shift gets a vote for each point that meets an occupied cell of a target.

    Args:
        objects: K objects.
        targets: Other sweeps.
        max_change_m: Longest shift tried.
        base: (K, 3) metres, motions to the next sweep that shifts are added to.
    """
    # Motions are those to the first target: over a longer time, a cell is a finer step of velocity.
    first_ratio = np.float32(targets[0].time_ratio)
    targets = [
        replace(target, time_ratio=target.time_ratio / float(first_ratio)) for target in targets
    ]
    base, reach_m = first_ratio * base, max_change_m * abs(float(first_ratio))
    margin_m = reach_m + float(np.abs(base).max(initial=0.0))
    grid = VotingGrid(
        objects.positions, margin_m * max(1.0, *(abs(target.time_ratio) for target in targets))
    )
    shifts = _shifts(round(reach_m / grid.cell_m))
    columns, levels = zip(
        *(
            grid.cells_of(objects.positions + np.float32(target.time_ratio) * base[objects.owners])
            for target in targets
        ),
        strict=True,
    )
    offsets = [
        grid.offsets(np.rint(shifts * target.time_ratio).astype(np.int64)) for target in targets
    ]
    chosen = _most_voted(
        np.stack(columns),
        np.stack(levels),
        objects.counts,
        np.stack(offsets),
        grid.occupied(targets),
    )
    voted = base.copy()
    voted[:, :2] += (shifts[chosen] * grid.cell_m).astype(np.float32)
    return fit_motion_field(objects, targets[0], voted) / first_ratio


@compiled("int64[::1](int64[:, ::1], int64[:, ::1], int64[::1], int64[:, ::1], uint16[:, ::1])")
def _most_voted(
    columns: Ints, levels: Ints, counts: Ints, offsets: Ints, occupied: NDArray[np.uint16]
) -> Ints:
    """Returns (K,) the row of the shift that most of each object's points agree on.

    Args:
        columns: (T, P) columns of the points, as they are compared with each target.
        levels: (T, P) bits of their levels.
        counts: (K,) number of points of each object.
        offsets: (T, S) what shifts add to a column.
        occupied: (T, C) bits of the levels that each target occupies.
    """
    chosen, num_shifts = np.zeros(len(counts), np.int64), offsets.shape[1]
    first = 0
    for owner in range(len(counts)):
        hits = np.zeros(num_shifts, np.int32)
        for target in range(len(columns)):
            for row in range(first, first + counts[owner]):
                level = levels[target, row]
                for shift in range(num_shifts):
                    column = columns[target, row] + offsets[target, shift]
                    if 0 <= column < occupied.shape[1] and occupied[target, column] & level:
                        hits[shift] += 1
        first += counts[owner]
        chosen[owner] = hits.argmax()
    return chosen


@lru_cache
def _shifts(radius: int) -> Ints:
    """(S, 2) all whole shifts in a disc, in cells, nearest first."""
    side = np.arange(-radius, radius + 1)
    x, y = (axis.ravel() for axis in np.meshgrid(side, side, indexing="ij"))
    length = x * x + y * y
    order = np.argsort(length, kind="stable")
    order = order[length[order] <= radius * radius]
    return np.stack([x[order], y[order]], axis=1)


class VotingGrid:
    """A grid in the current sweep's frame; columns of cells are numbered through.

    Attributes:
        cell_m: Size of a cell.
    """

    def __init__(self, points: Floats32, margin_m: float) -> None:
        """Lays a grid around points (N, 3), metres, and so far around them."""
        low = points[:, :2].min(axis=0).astype(np.float64) - margin_m
        high = points[:, :2].max(axis=0).astype(np.float64) + margin_m
        least_m = max((high - low).max() / MAX_CELLS_PER_AXIS, margin_m / _MAX_CELLS_OF_MARGIN)
        # Sizes are powers of two times the smallest, edges are multiples of the size: a slightly
        # larger margin hardly ever changes a cell.
        self.cell_m = _CELL_M * 2.0 ** max(0, math.ceil(math.log2(least_m / _CELL_M)))
        middle_m = (float(points[:, 2].min()) + float(points[:, 2].max())) / 2
        # A cell more on each side, for what rounding may do to a shift at the edge.
        first = np.floor(np.append(low, middle_m) / self.cell_m) - (1, 1, _NUM_LEVELS // 2)
        self._low = (first * self.cell_m).astype(np.float32)
        rows, columns = (np.floor(high / self.cell_m) - first[:2] + 2).astype(int)
        self._shape = (int(rows), int(columns))

    def offsets(self, shifts: Ints) -> Ints:
        """(S,) offsets in column numbers of shifts (S, 2), in cells."""
        return shifts[:, 0] * self._shape[1] + shifts[:, 1]

    def cells_of(self, points: Floats32) -> tuple[Ints, Ints]:
        """(P,) the columns of points (P, 3), and the bits of their levels.

        Points above or below all levels count in the highest or lowest one.
        """
        cells = np.floor((points - self._low) / np.float32(self.cell_m)).astype(np.int64)
        return self.offsets(cells[:, :2]), 1 << np.clip(cells[:, 2], 0, _NUM_LEVELS - 1)

    def occupied(self, targets: Sequence[Target]) -> NDArray[np.uint16]:
        """(T, columns) bits of the levels where targets have a point, right above or below."""
        occupied = np.zeros((len(targets), int(np.prod(self._shape))), np.uint16)
        cell_m = np.float32(self.cell_m)
        for target, columns in zip(targets, occupied, strict=True):
            transform = target.to_current[:3].astype(np.float32)
            _mark(columns, target.sweep.thinned, transform, self._low, cell_m, *self._shape)
        return occupied


@compiled(
    "void(uint16[::1], float32[:, ::1], float32[:, ::1], float32[::1], float32, int64, int64)"
)
def _mark(
    occupied: NDArray[np.uint16],
    points: Floats32,
    transform: Floats32,
    low: Floats32,
    cell_m: np.float32,
    num_rows: int,
    num_columns: int,
) -> None:
    """Marks the cells of transformed points that are inside, and those above and below."""
    cell = np.zeros(3, np.float32)
    for index in range(len(points)):
        x, y, z = points[index, 0], points[index, 1], points[index, 2]
        for axis in range(3):
            turned = x * transform[axis, 0] + y * transform[axis, 1] + z * transform[axis, 2]
            cell[axis] = np.floor((turned + transform[axis, 3] - low[axis]) / cell_m)
        is_inside = 0 <= cell[0] < num_rows and 0 <= cell[1] < num_columns
        if is_inside and 1 <= cell[2] < _NUM_LEVELS - 1:
            column = int(cell[0]) * num_columns + int(cell[1])
            occupied[column] |= np.uint16(7 << (int(cell[2]) - 1))
