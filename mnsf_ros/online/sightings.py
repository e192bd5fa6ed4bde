# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Sightings: measurements of one estimate for the tracks."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import Verdict
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.online.object_points import NOISE_M
from mnsf_ros.online.table import ObjectTable

# Standard deviation of a motion that the points constrain.
_MOTION_M: Final = 0.03


@dataclass(frozen=True, eq=False)
class Sightings:
    """G things that move, or may move, in the world; each may be several objects.

    Attributes:
        motions: (G, 3) float32, metres to the next sweep, axes of the sensor.
        states: (G, 2, 3) middle of the points in metres, velocity in metres per second.
        scores: (G,) log-odds that they move, of their likeliest object.
        are_moving: (G,) whether an object of theirs is called dynamic.
        turn_rates: (G,) radians per second, to the left.
        variances: (G, 2) of place and velocity along each axis.
        points: (P, 3) metres.
        owners: (P,) int from 0 to G - 1, rising.
    """

    motions: NDArray[np.float32]
    states: NDArray[np.float64]
    scores: NDArray[np.float64]
    are_moving: NDArray[np.bool_]
    turn_rates: NDArray[np.float64]
    variances: NDArray[np.float64]
    points: NDArray[np.float64]
    owners: NDArray[np.int64]

    @classmethod
    def of(
        cls, table: ObjectTable, world_from_sensor: NDArray[np.float64], interval_s: float
    ) -> "Sightings":
        """Returns the groups of the table in the world frame, turn rates 0.

        Args:
            table: Objects of the current sweep, some of them in groups.
            world_from_sensor: (4, 4) pose of the sensor.
            interval_s: Time to the next sweep, above 0.
        """
        followed = table.take(np.flatnonzero(table.groups >= 0))
        movers, groups, motions = followed.points, followed.groups, followed.moving.motions
        scores, residual_rise = followed.scores, followed.residual_rise
        is_moving = followed.verdicts == Verdict.DYNAMIC
        number = int(groups.max(initial=-1)) + 1
        order = np.argsort(groups[movers.owners], kind="stable")
        points = transformed(movers.positions, world_from_sensor)[order].astype(np.float64)
        owners = groups[movers.owners][order]
        counts = movers.counts.astype(np.float64)
        weights = np.bincount(groups, counts, number)[:, None]
        centers = _sums(points, owners, number) / weights
        means = _sums(motions * counts[:, None], groups, number) / weights
        velocities = turned(means, world_from_sensor[:3, :3]) / interval_s
        # The middle of the visible points shifts when another side comes into view.
        spread = np.sqrt(_sums((points - centers[owners]) ** 2, owners, number) / weights)
        place_errors = spread.max(axis=1, initial=0.0)
        # If shifted motions hardly raise the residual, the velocity is uncertain.
        shares = np.bincount(groups, counts * residual_rise, number) / weights[:, 0] / (2 * NOISE_M)
        velocity_errors = _MOTION_M / interval_s / np.clip(shares, 1e-3, 1.0)
        variances = np.stack([place_errors, velocity_errors], axis=1) ** 2
        best = np.full(number, -np.inf)
        np.maximum.at(best, groups, scores)
        are_moving = np.bincount(groups, is_moving, number) > 0
        states = np.stack([centers, velocities], axis=1)
        means_m = means.astype(np.float32)
        turns = np.zeros(number)
        return cls(means_m, states, best, are_moving, turns, variances, points, owners)

    def __len__(self) -> int:
        return len(self.states)

    @property
    def points_of_each(self) -> list[NDArray[np.float64]]:
        """(P, 3) metres of each thing."""
        starts = np.searchsorted(self.owners, np.arange(1, len(self)))
        return np.split(self.points, starts) if len(self) else []


def _sums(
    values: NDArray[np.float64], owners: NDArray[np.int64], number: int
) -> NDArray[np.float64]:
    """Returns (number, 3) sums of the rows (P, 3) of each owner."""
    columns = [np.bincount(owners, values[:, axis], number) for axis in range(3)]
    return np.stack(columns, axis=1)
