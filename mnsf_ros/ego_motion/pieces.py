# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Separate pieces of the scene as witnesses: which of them agree with a motion of the sensor.

Most of what stands around a sensor does not move, so the right motion is the one that most pieces
agree with. Each piece has one voice, however many points it has: a long wall that is the same all
along, or a bus beside the sensor, does not outvote the rest.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from mnsf_ros.arrays import Bools, Floats, Floats32, Ints
from mnsf_ros.ego_motion.cloud import HEIGHT_SHARE, Cloud

_WIDTH_M: Final = 1.0
_MIN_POINTS: Final = 5
# Pieces stand upright: the trace of a laser on the ground or a ceiling moves along with the sensor.
_MIN_HEIGHT_M: Final = 0.3
_NEAR_M: Final = 2.0  # the robot itself is nearer
_FAR_M: Final = 50.0  # farther out, points are too far apart
# How far the nearest of the thinned points of the same surface may be: besides, by so many steps
# between the columns of the lidar, as on walls seen from aside.
_SPACING_M: Final = 0.1
_SPACING_PER_M: Final = 0.005
_NUM_STEPS: Final = 0.75
# Mean distance of a piece beyond that.
_MAX_RESIDUAL_M: Final = 0.05
# Fewer pieces are no majority.
_MIN_PIECES: Final = 10
# Share of the pieces that come into view on the way: of a street .28 within 12 m. Where the view is
# narrow, it is lost in turns.
_NEW_PER_M: Final = 0.04
_NEW_PER_RAD: Final = 0.3


@dataclass(frozen=True, eq=False)
class Pieces:
    """K upright pieces of a cloud, each within a square seen from above.

    Attributes:
        points: (P, 3) float32, metres, frame of the sensor.
        owners: (P,) from 0 to K - 1, rising.
        counts: (K,) points of each.
        spacing: (P,) float32, metres; another point so near may be of the same surface.
    """

    points: Floats32
    owners: Ints
    counts: Ints
    spacing: Floats32

    @classmethod
    def of(cls, cloud: Cloud, azimuth_step_rad: float) -> "Pieces":
        """Returns the pieces of a cloud, whose columns are a step apart."""
        points = cloud.points[: cloud.num_standing]
        ranges = np.hypot(points[:, 0], points[:, 1])
        points = points[(ranges > _NEAR_M) & (ranges < _FAR_M)]
        squares = np.floor(points[:, :2] / _WIDTH_M).astype(np.int64)
        keys = squares[:, 0] * 2**20 + squares[:, 1]
        order = np.argsort(keys, kind="stable")
        points, keys = np.take(points, order, axis=0), keys[order]
        _, starts, owners, counts = np.unique(keys, True, True, True)
        if len(counts):
            heights = np.maximum.reduceat(points[:, 2], starts)
            heights -= np.minimum.reduceat(points[:, 2], starts)
            is_piece = (counts >= _MIN_POINTS) & (heights > _MIN_HEIGHT_M)
            numbers, counts = np.cumsum(is_piece) - 1, counts[is_piece]
            rows = np.flatnonzero(is_piece[owners])
            points, owners = np.take(points, rows, axis=0), numbers[owners[rows]]
        ranges = np.sqrt((points**2).sum(axis=1))
        per_m = max(_SPACING_PER_M, _NUM_STEPS * azimuth_step_rad)
        return cls(points, owners, counts, (_SPACING_M + per_m * ranges).astype(np.float32))

    def __len__(self) -> int:
        return len(self.counts)

    def agree(self, motion: Floats, other: Cloud) -> Bools:
        """Returns (K,) which pieces are on points of another cloud, seen from above.

        Args:
            motion: (4, 4) other_from_own.
            other: The other cloud.
        """
        no_motions = np.zeros((len(self), 3), np.float32)
        flat = np.diag([1.0, 1.0, HEIGHT_SHARE, 1.0]) @ motion
        points = other.from_above
        sums, _, _ = points.compared(self.points, self.owners, no_motions, flat, self.spacing)
        return np.asarray(sums < _MAX_RESIDUAL_M * self.counts)


@dataclass(frozen=True)
class Testimony:
    """What the pieces of a sweep say of its motion since an earlier one.

    Attributes:
        num_against: Number of pieces that do not agree.
        share: Their share of all, without those that may have come into view on the way.
    """

    num_against: int
    share: float

    @classmethod
    def of(cls, pieces: Pieces, motion: Floats, other: Cloud | None) -> "Testimony":
        """Returns what pieces say of a motion (4, 4) other_from_own; nothing if there are few."""
        if len(pieces) < _MIN_PIECES or other is None:
            return cls(0, 0.0)
        num_against = len(pieces) - int(np.count_nonzero(pieces.agree(motion, other)))
        new = _NEW_PER_M * np.linalg.norm(motion[:3, 3]) + _NEW_PER_RAD * angle_of(motion)
        return cls(num_against, float(num_against / len(pieces) - new))

    def contradicts_more(self, other: "Testimony", deviations: float) -> bool:
        """Whether by so many standard deviations more pieces contradict this motion than another.

        Pieces that do are counted as events by chance are.
        """
        number = self.num_against + other.num_against
        return bool(self.num_against - other.num_against > deviations * np.sqrt(number))


def angle_of(motion: Floats) -> float:
    """Returns the angle of a motion (4, 4), radians."""
    return float(Rotation.from_matrix(motion[:3, :3]).magnitude())
