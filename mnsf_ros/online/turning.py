# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of objects that turn: a linear head on an encoding of the position.

The encoding of a point consists of 1 and its horizontal offset from the middle of its object.
Gauss-Newton steps fit the head of each object to a target sweep. The fit may turn, stretch and
shear an object; `turning` keeps the horizontal motion and the turn only.
"""

from collections.abc import Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.compiled import compiled
from mnsf_ros.geometry.rigid_motion import transformed, turned
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.table import ObjectTable
from mnsf_ros.online.target import NUM_ITERATIONS, Target, Targets

# Prior weights of the constant and of the offsets, in points: objects are nearly rigid.
_PRIOR: Final = np.diag((1e-3, 8.0, 8.0))
# A point this far from the target, plus twice its spacing, has half of its weight.
_HALF_WEIGHT_M: Final = 0.1

# (K, 3, 3) for K objects: the flow to the next sweep, in metres, per unit of the constant and of
# each offset of the encoding.
Heads = NDArray[np.float64]


def rigid_heads(
    motions: NDArray[np.floating[Any]], turns: NDArray[np.float64] | float = 0.0
) -> Heads:
    """Returns the heads (K, 3, 3) of objects that move by (K, 3) metres and turn by (K,) radians.

    Turns are small angles about the middle, positive to the left.
    """
    heads: Heads = np.zeros((len(motions), 3, 3))
    heads[:, 0] = motions
    heads[:, 1, 1], heads[:, 2, 0] = turns, np.negative(turns)
    return heads


def turns_of(heads: Heads) -> NDArray[np.float64]:
    """Returns (K,) the turn angles of heads (K, 3, 3), radians."""
    return np.asarray((heads[:, 1, 1] - heads[:, 2, 0]) / 2, np.float64)


class EncodedPoints:
    """Points of objects, encoded, to fit heads to targets."""

    def __init__(
        self, objects: ObjectPoints, motions: NDArray[np.float32], targets: Sequence[Target]
    ) -> None:
        """Encodes the points.

        Args:
            objects: K objects.
            motions: (K, 3) metres to the next sweep; they decide when a target measures an object.
            targets: The sweeps that heads are fitted to.
        """
        self._objects = objects
        self._intervals = {target: target.intervals_of(objects, motions) for target in targets}
        self._encoding = encoded(objects.positions - objects.centers[objects.owners])
        self._each = np.arange(len(objects.owners))

    def residuals(self, target: Target, heads: Heads) -> NDArray[np.float64]:
        """Returns (K,) metres, the residual of each object on a target, moved by its head."""
        objects = self._objects
        moved = self._flow(self._intervals[target][:, :, None] * heads)
        points, each, transform = objects.positions, self._each, target.from_current
        distances, _, _ = target.sweep.grid.compared(
            points, each, moved, transform, objects.spacing, target.limits_m(objects, moved)
        )
        return np.asarray(objects.sums(distances) / objects.counts, np.float64)

    def fitted(self, target: Target, start: Heads) -> Heads:
        """Returns heads that move the points onto a target.

        They minimize a robust D(p + g(p), S) plus a prior around the start.

        Args:
            target: The target sweep S.
            start: The heads to start from.
        """
        objects = self._objects
        intervals = self._intervals[target][:, :, None]
        start = intervals * start
        begin = flow = self._flow(start)
        points, each, transform = objects.positions, self._each, target.from_current
        places = transformed(points + begin, transform)
        is_unseen = target.are_unseen(places)
        half_m = _HALF_WEIGHT_M + 2 * objects.spacing
        heads, exactly = start, np.zeros_like(objects.spacing)
        for _ in range(NUM_ITERATIONS):
            distances, vectors, counts = target.sweep.grid.compared(
                points, each, flow, transform, exactly
            )
            weights = (counts > 0) * ~is_unseen / (1 + (distances / half_m) ** 2)
            wanted = turned(vectors, transform[:3, :3].T) + flow - begin
            left, right = _normal_equations(
                self._encoding, objects.owners, weights, wanted, len(objects)
            )
            heads = start + np.linalg.solve(left + _PRIOR, right)
            flow = self._flow(heads)
        return np.asarray(heads / intervals, np.float64)

    def _flow(self, heads: Heads) -> NDArray[np.float32]:
        """Returns (P, 3) metres, the flow of the points."""
        return headed(self._encoding, self._objects.owners, heads)


def encoded(offsets: NDArray[np.float32]) -> NDArray[np.float64]:
    """Returns (P, 3) the encodings of points at offsets (P, 3) from their middle, metres."""
    encoding = np.ones((len(offsets), 3))
    encoding[:, 1:] = offsets[:, :2]
    return encoding


@compiled("float32[:, ::1](float64[:, ::1], int64[::1], float64[:, :, ::1])")
def headed(
    encoding: NDArray[np.float64], owners: NDArray[np.int64], heads: Heads
) -> NDArray[np.float32]:
    """Returns (P, 3) metres, the flow of encodings (P, 3) by the heads of their owners (P,)."""
    flow = np.empty((len(encoding), 3), np.float32)
    for row in range(len(encoding)):
        one, ahead, aside = encoding[row]
        head = heads[owners[row]]
        for axis in range(3):
            flow[row, axis] = one * head[0, axis] + ahead * head[1, axis] + aside * head[2, axis]
    return flow


@compiled(
    "UniTuple(float64[:, :, ::1], 2)"
    "(float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], int64)"
)
def _normal_equations(
    encoding: NDArray[np.float64],
    owners: NDArray[np.int64],
    weights: NDArray[np.float64],
    wanted: NDArray[np.float64],
    num_objects: int,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Returns the left and the right sides, (num_objects, 3, 3) each, of weighted least squares.

    Args:
        encoding: (P, 3) of the points.
        owners: (P,) their objects.
        weights: (P,) how much each counts.
        wanted: (P, 3) metres, the target values of the flow.
        num_objects: How many objects there are.
    """
    left, right = np.zeros((num_objects, 3, 3)), np.zeros((num_objects, 3, 3))
    for row in range(len(encoding)):
        owner = owners[row]
        for feature in range(3):
            weighted = weights[row] * encoding[row, feature]
            for column in range(3):
                left[owner, feature, column] += weighted * encoding[row, column]
                right[owner, feature, column] += weighted * wanted[row, column]
    return left, right


def with_turns(table: ObjectTable, scene: Scene) -> ObjectTable:
    """Fills `heads` of the movers: how their groups move and turn."""
    movers = table.movers
    moving, groups = np.unique(movers.groups, return_inverse=True)
    turns = np.zeros(len(moving))
    turns[groups] = movers.prior.turn_rates * scene.usual_interval_s
    motions = table.group_motions[moving].astype(np.float32)
    heads = turning(movers.points, groups, motions, turns, scene.targets)
    return table.put(table.mover_rows, heads=heads)


def turning(
    movers: ObjectPoints,
    groups: NDArray[np.int64],
    motions: NDArray[np.float32],
    turns: NDArray[np.float64],
    targets: Targets,
) -> Heads:
    """Returns the heads (K, 3, 3) of K movers: motions of their middles, and turns about these.

    Each group moves and turns as one rigid body. One head per group is fitted to each neighbouring
    sweep, starting from the predicted turn, which remains where the points do not constrain it. The
    mean of these heads is reduced to its horizontal motion and its turn. If this does not lower
    the residual, the given motion is kept, without a turn.

    Args:
        movers: K objects.
        groups: (K,) from 0 to G - 1, the group of each mover.
        motions: (G, 3) metres, motions of the groups to the next sweep.
        turns: (G,) radians, their predicted turns until then.
        targets: The other sweeps.
    """
    bodies = movers.joined(groups)
    straight = rigid_heads(motions)
    points = EncodedPoints(bodies, motions, targets.near)
    start = rigid_heads(motions, turns)
    fitted = np.mean([points.fitted(each, start) for each in targets.near], axis=0)
    rigid = rigid_heads(
        np.concatenate([fitted[:, 0, :2], motions[:, 2:]], axis=1), turns_of(fitted)
    )
    before, after = (
        np.mean([points.residuals(target, heads) for target in targets.near], axis=0)
        for heads in (straight, rigid)
    )
    heads = np.where((after < before)[:, None, None], rigid, straight)[groups]
    offsets = encoded(movers.centers - bodies.centers[groups])
    heads[:, 0] = (offsets[:, :, None] * heads).sum(axis=1)
    return heads
