# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The flow of objects that turn: linear in the position.

The features of a point are 1 and its horizontal offsets from the middle of its object.
Gauss-Newton steps fit the linear motion of each object to a target sweep. The fit may turn, stretch
and shear an object; `turning` keeps the horizontal motion and the turn only.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np

from mnsf_ros.arrays import AnyFloats, Floats, Floats32, Ints
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

# (K, 3, 3) for K objects: the flow to the next sweep, in metres: that of the middle, and what each
# metre of an offset adds.
LinearMotions = Floats


def rigid_motions(motions: AnyFloats, turns: Floats | float = 0.0) -> LinearMotions:
    """Returns the linear motions of objects that move by (K, 3) metres and turn by (K,) radians.

    Turns are small angles about the middle, positive to the left.
    """
    linear: LinearMotions = np.zeros((len(motions), 3, 3))
    linear[:, 0] = motions
    linear[:, 1, 1], linear[:, 2, 0] = turns, np.negative(turns)
    return linear


def turns_of(linear: LinearMotions) -> Floats:
    """Returns (K,) the turn angles of linear motions, radians."""
    return np.asarray((linear[:, 1, 1] - linear[:, 2, 0]) / 2, np.float64)


class LinearFit:
    """Points of objects, to fit linear motions to targets."""

    def __init__(self, objects: ObjectPoints, motions: Floats32, targets: Sequence[Target]) -> None:
        """Computes the features of the points.

        Args:
            objects: K objects.
            motions: (K, 3) metres to the next sweep; they decide when a target measures an object.
            targets: The sweeps that linear motions are fitted to.
        """
        self._objects = objects
        self._time_ratios = {target: target.time_ratios_of(objects, motions) for target in targets}
        self._features = with_offsets(objects.positions - objects.centers[objects.owners])
        self._each = np.arange(len(objects.owners))

    def residuals(self, target: Target, linear: LinearMotions) -> Floats:
        """Returns (K,) metres, the residual of each object on a target, after its motion."""
        objects = self._objects
        moved = self._flow(self._time_ratios[target][:, :, None] * linear)
        points, each, transform = objects.positions, self._each, target.from_current
        distances, _, _ = target.sweep.grid.compared(
            points, each, moved, transform, objects.spacing, target.limits_m(objects, moved)
        )
        return np.asarray(objects.sums(distances) / objects.counts, np.float64)

    def fitted(self, target: Target, start: LinearMotions) -> LinearMotions:
        """Returns linear motions that move the points onto a target.

        They minimize a robust D(p + g(p), S) plus a prior around the start.

        Args:
            target: The target sweep S.
            start: The linear motions to start from.
        """
        objects = self._objects
        time_ratios = self._time_ratios[target][:, :, None]
        start = time_ratios * start
        begin = flow = self._flow(start)
        points, each, transform = objects.positions, self._each, target.from_current
        places = transformed(points + begin, transform)
        is_unseen = target.are_unseen(places)
        half_m = _HALF_WEIGHT_M + 2 * objects.spacing
        linear, exactly = start, np.zeros_like(objects.spacing)
        for _ in range(NUM_ITERATIONS):
            distances, vectors, counts = target.sweep.grid.compared(
                points, each, flow, transform, exactly
            )
            weights = (counts > 0) * ~is_unseen / (1 + (distances / half_m) ** 2)
            wanted = turned(vectors, transform[:3, :3].T) + flow - begin
            left, right = _normal_equations(
                self._features, objects.owners, weights, wanted, len(objects)
            )
            # Each 3 x 3 system has a LAPACK call of its own, too small for threads: same digits.
            linear = start + np.linalg.solve(left + _PRIOR, right)
            flow = self._flow(linear)
        return np.asarray(linear / time_ratios, np.float64)

    def _flow(self, linear: LinearMotions) -> Floats32:
        """Returns (P, 3) metres, the flow of the points."""
        return flow_by(self._features, self._objects.owners, linear)


def with_offsets(offsets: Floats32) -> Floats:
    """Returns (P, 3) features, 1 and horizontal offsets, of points at offsets (P, 3), metres."""
    features = np.ones((len(offsets), 3))
    features[:, 1:] = offsets[:, :2]
    return features


@compiled("float32[:, ::1](float64[:, ::1], int64[::1], float64[:, :, ::1])")
def flow_by(features: Floats, owners: Ints, linear: LinearMotions) -> Floats32:
    """Returns (P, 3) metres, the flow of features (P, 3) by the motions of their owners (P,)."""
    flow = np.empty((len(features), 3), np.float32)
    for row in range(len(features)):
        one, ahead, aside = features[row]
        own = linear[owners[row]]
        for axis in range(3):
            flow[row, axis] = one * own[0, axis] + ahead * own[1, axis] + aside * own[2, axis]
    return flow


@compiled(
    "UniTuple(float64[:, :, ::1], 2)"
    "(float64[:, ::1], int64[::1], float64[::1], float64[:, ::1], int64)"
)
def _normal_equations(
    features: Floats, owners: Ints, weights: Floats, wanted: Floats, num_objects: int
) -> tuple[Floats, Floats]:
    """Returns the left and the right sides, (num_objects, 3, 3) each, of weighted least squares.

    Args:
        features: (P, 3) of the points.
        owners: (P,) their objects.
        weights: (P,) how much each counts.
        wanted: (P, 3) metres, the target values of the flow.
        num_objects: How many objects there are.
    """
    left, right = np.zeros((num_objects, 3, 3)), np.zeros((num_objects, 3, 3))
    for row in range(len(features)):
        owner = owners[row]
        for feature in range(3):
            weighted = weights[row] * features[row, feature]
            for column in range(3):
                left[owner, feature, column] += weighted * features[row, column]
                right[owner, feature, column] += weighted * wanted[row, column]
    return left, right


def with_turns(table: ObjectTable, scene: Scene) -> ObjectTable:
    """Fills `linear_motions` of the movers: how their groups move and turn."""
    movers = table.movers
    moving_groups, groups = np.unique(movers.groups, return_inverse=True)
    turns = np.zeros(len(moving_groups))
    # The member with most points where its track predicts them decides, thus comes last: a
    # fragment without a track must not erase the turn of its group.
    order = np.argsort(movers.prior.shares * movers.points.counts, kind="stable")
    turns[groups[order]] = movers.prior.turn_rates[order] * scene.usual_interval_s
    motions = table.group_motions[moving_groups].astype(np.float32)
    linear = turning(movers.points, groups, motions, turns, scene.targets)
    return table.put(table.mover_rows, linear_motions=linear)


def turning(
    movers: ObjectPoints, groups: Ints, motions: Floats32, turns: Floats, targets: Targets
) -> LinearMotions:
    """Returns the linear motions of K movers: motions of their middles, and turns about these.

    Each group moves and turns as one rigid body. One linear motion per group is fitted to each
    neighbouring sweep, starting from the predicted turn, which remains where the points do not
    constrain it. The mean of these is reduced to its horizontal motion and its turn. If this does
    not lower the residual, the given motion is kept, without a turn.

    Args:
        movers: K objects.
        groups: (K,) from 0 to G - 1, the group of each mover.
        motions: (G, 3) metres, motions of the groups to the next sweep.
        turns: (G,) radians, their predicted turns until then.
        targets: The other sweeps.
    """
    bodies = movers.joined(groups)
    straight = rigid_motions(motions)
    fit = LinearFit(bodies, motions, targets.near)
    start = rigid_motions(motions, turns)
    fitted = np.mean([fit.fitted(each, start) for each in targets.near], axis=0)
    rigid = rigid_motions(
        np.concatenate([fitted[:, 0, :2], motions[:, 2:]], axis=1), turns_of(fitted)
    )
    before, after = (
        np.mean([fit.residuals(target, linear) for target in targets.near], axis=0)
        for linear in (straight, rigid)
    )
    linear = np.where((after < before)[:, None, None], rigid, straight)[groups]
    # From the motion of the group's middle to that of each mover's middle.
    features = with_offsets(movers.centers - bodies.centers[groups])
    linear[:, 0] = (features[:, :, None] * linear).sum(axis=1)
    return linear
