# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Objects of a sweep: records with a row for each, and the points that represent them."""

from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.point_sets import chosen_points
from mnsf_ros.online.object_sweep import ObjectSweep
from mnsf_ros.settings import ObjectSettings

_Own = TypeVar("_Own", bound="Rows")


# Distance between points of the same surface in two sweeps: noise of the ranges, and half of the
# 0.4 degrees between the beams of a 64-beam lidar.
NOISE_M: Final = 0.02
_SPACING_PER_M: Final = 0.0035
# This many points of an object are enough to compare motions roughly.
_FEW: Final = 16


class Rows:
    """Base of frozen dataclasses whose fields are arrays (K, ...) or such records themselves."""

    def select(self: _Own, rows: Ints) -> _Own:
        """Returns the record of some of the objects, by their rows."""
        taken: dict[str, Any] = {}
        for field in fields(self):  # type: ignore[arg-type]
            column = getattr(self, field.name)
            taken[field.name] = column.select(rows) if isinstance(column, Rows) else column[rows]
        return replace(self, **taken)  # type: ignore[type-var]

    def put(self: _Own, rows: Ints, **columns: Any) -> _Own:  # noqa: ANN401
        """Returns the record with other values in some rows of these columns."""
        changed: dict[str, Any] = {}
        for name, values in columns.items():
            column = getattr(self, name)
            if isinstance(column, Rows):
                own = {field.name: getattr(values, field.name) for field in fields(values)}
                changed[name] = column.put(rows, **own)
            else:
                changed[name] = column.copy()
                changed[name][rows] = values
        return replace(self, **changed)  # type: ignore[type-var]


@dataclass(frozen=True, eq=False)
class ObjectPoints(Rows):
    """Points of K objects, ordered by object.

    Attributes:
        numbers: (K,) int, the objects' numbers in their sweep.
        positions: (P, 3) float32, metres, frame of the current sweep.
        owners: (P,) int from 0 to K - 1, rising.
        spacing: (P,) float32, metres; a nearest point within it is not evidence of motion.
    """

    numbers: Ints
    positions: Floats32
    owners: Ints
    spacing: Floats32

    @classmethod
    def of(cls, sweep: ObjectSweep, settings: ObjectSettings) -> "ObjectPoints":
        """Chooses points of each object that is neither too small nor too large to move."""
        points, objects = sweep.members
        numbers, chosen, owners = _chosen(
            points, objects, sweep.is_short_enough, settings.min_points, settings.points_per_object
        )
        return cls(numbers, chosen, owners, spacing_of(chosen))

    def __len__(self) -> int:
        return len(self.numbers)

    def rows_of(self, num_objects: int) -> Ints:
        """Returns (num_objects,) the row of each object of the sweep; -1 for those not here."""
        rows = np.full(num_objects, -1)
        rows[self.numbers] = np.arange(len(self))
        return rows

    def all_points(self, sweep: ObjectSweep) -> tuple[Floats32, Ints]:
        """Returns (A, 3) metres, all thinned points of the objects, and (A,) the rows of these."""
        points, objects = sweep.members
        rows = self.rows_of(sweep.num_objects)[objects]
        return chosen_points(points, rows >= 0), rows[rows >= 0]

    def select(self, rows: Ints) -> "ObjectPoints":
        """Returns some of the objects, by their rows, which rise."""
        places = np.full(len(self), -1)
        places[rows] = np.arange(len(rows))
        owners = places[self.owners]
        return self._with_points(np.flatnonzero(owners >= 0), self.numbers[rows], owners)

    def repeated(self, times: int) -> "ObjectPoints":
        """Returns so many copies of the objects as new objects: one call is faster than several."""
        owners = np.arange(times)[:, None] * len(self) + self.owners
        return ObjectPoints(
            np.tile(self.numbers, times),
            np.tile(self.positions, (times, 1)),
            owners.ravel(),
            np.tile(self.spacing, times),
        )

    def joined(self, groups: Ints) -> "ObjectPoints":
        """Returns the objects of each group (K,), numbers from 0 to G - 1, as one object.

        Its points are not in the order of their heights, as `tops` expects.
        """
        order = np.argsort(groups[self.owners], kind="stable")
        _, first = np.unique(groups, return_index=True)
        return self._with_points(order, self.numbers[first], groups[self.owners])

    def thinner(self) -> "ObjectPoints":
        """Returns the same objects with few points each."""
        stride = np.maximum(1, -(-self.counts // _FEW))[self.owners]
        is_chosen = (np.arange(len(self.owners)) - self.starts[self.owners]) % stride == 0
        return self._with_points(np.flatnonzero(is_chosen), self.numbers, self.owners)

    def _with_points(self, rows: Ints, numbers: Ints, owners: Ints) -> "ObjectPoints":
        """Returns some points of the objects left, by their rows; (P,) owners of all points."""
        # np.take is several times faster than positions[rows].
        positions = np.take(self.positions, rows, axis=0)
        return ObjectPoints(numbers, positions, owners[rows], self.spacing[rows])

    @cached_property
    def counts(self) -> Ints:
        """(K,) the number of points of each object."""
        return np.bincount(self.owners, minlength=len(self))

    @cached_property
    def starts(self) -> Ints:
        """(K,) the first point of each object."""
        counts = self.counts
        return np.cumsum(counts) - counts

    @cached_property
    def centers(self) -> Floats32:
        """(K, 3) metres, the middle of each object's points."""
        sums: Floats32 = self.sums(self.positions)
        return np.divide(sums, self.counts[:, None], dtype=np.float32)

    @cached_property
    def variances(self) -> tuple[Floats, ...]:
        """Four times (K,) square metres, of each object's points: xx, yy, xy, zz."""
        x, y, z = (self.positions - self.centers[self.owners]).T.astype(np.float64)
        return tuple(self.sums(each) / self.counts for each in (x * x, y * y, x * y, z * z))

    @property
    def angles(self) -> Floats:
        """(K,) radians, the horizontal direction along which each object is longest."""
        xx, yy, xy, _ = self.variances
        return np.arctan2(2 * xy, xx - yy) / 2

    @property
    def extents(self) -> tuple[Floats, ...]:
        """Three times (K,) metres: how long, wide and high each object is, as its points spread."""
        xx, yy, xy, zz = self.variances
        half, root = (xx + yy) / 2, np.sqrt(((xx - yy) / 2) ** 2 + xy**2)
        # The variance of points spread evenly is a twelfth of the squared size.
        return tuple(np.sqrt(12 * np.maximum(each, 0.0)) for each in (half + root, half - root, zz))

    @property
    def thicknesses(self) -> Floats:
        """(K,) metres, the height of each object, or its width if that is smaller.

        Strips of walls and single rings on crowns of trees and tables are thin. Their visible part
        changes from sweep to sweep as if they moved.
        """
        _, widths, heights = self.extents
        return np.minimum(widths, heights)

    @property
    def tops(self) -> Floats:
        """(K,) metres, how far each object reaches above the sensor; 0 if it does not.

        The height of an object is estimated as twice the height of the middle half of its points.
        This ignores points above a mover, such as the roof of a tunnel or the crown of a tree. The
        points must be in the order of their heights, as of `thinned`; after `joined` they are not.
        """
        low, high = (self.positions[self.starts + share * self.counts // 4, 2] for share in (1, 3))
        return np.maximum(self.centers[:, 2] + (high - low), 0).astype(np.float64)

    def sums(self, values: NDArray[Any]) -> NDArray[Any]:
        """(K, ...) sums over each object's points of values (P, ...)."""
        if len(self) == 0:
            return np.zeros((0, *values.shape[1:]), values.dtype)
        return np.add.reduceat(values, self.starts, axis=0)


def spacing_of(points: Floats32) -> Floats32:
    """Returns (P,) metres, how far points (P, 3) may be from others of the same surface."""
    ranges = np.sqrt((points * points).sum(axis=1))
    return (NOISE_M + _SPACING_PER_M * ranges).astype(np.float32)


@compiled(
    "Tuple((int64[::1], float32[:, ::1], int64[::1]))"
    "(float32[:, ::1], int64[::1], boolean[::1], int64, int64)"
)
def _chosen(
    points: Floats32, objects: Ints, is_short_enough: Bools, min_points: int, max_points: int
) -> tuple[Ints, Floats32, Ints]:
    """Chooses points (T, 3) of objects (T,) that are short enough and have enough points.

    Returns:
        (K,) the objects, (P, 3) their points, at most so many of each, and (P,) from 0 to K - 1.
    """
    num_objects = len(is_short_enough)
    counts = np.zeros(num_objects, np.int64)
    for row in range(len(points)):
        counts[objects[row]] += 1
    owner_of, first_of = np.full(num_objects, -1, np.int64), np.zeros(num_objects, np.int64)
    num_owners, num_chosen = 0, 0
    for number in range(1, num_objects):
        if counts[number] >= min_points and is_short_enough[number]:
            owner_of[number], first_of[number] = num_owners, num_chosen
            num_owners += 1
            num_chosen += min(counts[number], max_points)
    ranks = np.zeros(num_objects, np.int64)
    positions = np.empty((num_chosen, 3), np.float32)
    owners = np.empty(num_chosen, np.int64)
    for row in range(len(points)):
        number = objects[row]
        if owner_of[number] < 0:
            continue
        count, rank = counts[number], ranks[number]
        ranks[number] += 1
        # Evenly over the object: a rank is chosen where rank * wanted / count passes an integer.
        wanted = min(count, max_points)
        place = rank * wanted // count
        if place != (rank + 1) * wanted // count:
            owners[first_of[number] + place] = owner_of[number]
            for axis in range(3):
                positions[first_of[number] + place, axis] = points[row, axis]
    return np.flatnonzero(owner_of >= 0), positions, owners
