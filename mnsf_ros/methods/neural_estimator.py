# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The paper's method at the rate of the sensor: small fields, only where something may move.

Forward field, backward field, inversion and learned fusion, as in section 3 of the paper, without
the ego motion. There is one more backward field for each older sweep, as in the paper's method for
more than three sweeps. Which objects may move, where the fits start and what is called dynamic is
as in the online method; the motions that the tracks expect are the warm start.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, cast

import numpy as np
from numpy.typing import NDArray

from mnsf_ros.core.flow_estimate import StageClock
from mnsf_ros.objects.decision import Decision
from mnsf_ros.objects.encoded_field import EncodedPoints, Heads, whole
from mnsf_ros.objects.motions import JudgedMotions
from mnsf_ros.objects.object_flow import ObjectFlowEstimator
from mnsf_ros.objects.proposals import Suspects
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.target import Targets

# How much residual makes a flow e times less likely.
_FUSION_M: Final = 0.02
_PAST_WEIGHT: Final = 0.3


@dataclass(frozen=True, eq=False)
class FieldFlow(JudgedMotions):
    """The flow of K objects by a field, and how well it explains the other sweeps.

    Attributes:
        heads: (K, 3, 3) metres to the next sweep, see `encoded_field`; `motions` are those of the
            middles.
    """

    heads: Heads

    @property
    def loss(self) -> NDArray[np.float64]:
        """(K,) metres; older sweeps count less, as nothing moves evenly over a longer time."""
        past = self.past.mean(axis=1) if self.past.shape[1] else 0.0
        return np.asarray(self.cost + _PAST_WEIGHT * past, np.float64)

    @classmethod
    def of(cls, points: EncodedPoints, targets: Targets, heads: Heads) -> "FieldFlow":
        """Measures the flow by heads (K, 3, 3) on all targets."""
        near, past = (
            np.stack([points.residuals(target, heads) for target in some], axis=1)
            if some
            else np.zeros((len(heads), 0))
            for some in (targets.near, targets.past)
        )
        motions = heads[:, 0].astype(np.float32)
        return cls(motions, near, past, heads)


class NeuralEstimator(ObjectFlowEstimator):
    """Estimates scene flow as ego motion plus fields fitted to what may move.

    `prepare` and `estimate` may run in two threads. On the CPU only, without PyTorch.
    """

    def moved(
        self, suspects: Suspects, scene: Scene, start: NDArray[np.float32], clock: StageClock
    ) -> JudgedMotions:
        """Forward field, backward fields, inversion, fusion; arguments as of the online method."""
        objects, targets = suspects.objects, scene.targets
        all_targets = (*targets.near, *targets.past)
        steps = {target: target.steps_of(objects, start) for target in all_targets}
        points, few = (
            EncodedPoints(some, objects.centers, steps) for some in (objects, objects.thinner())
        )
        starts = [
            FieldFlow.of(few, targets, whole(each)) for each in suspects.expected.beside(start)
        ]
        flows: list[FieldFlow] = []
        for target in all_targets:
            with clock.stage("backward" if flows else "forward"):
                heads = points.fitted(target, _best([*starts, *flows]))
                flows.append(FieldFlow.of(few, targets, heads))
        with clock.stage("fusion"):
            forward, backward = flows[0], flows[len(targets.near) - 1]
            # Their mean is a candidate of its own: their errors often have opposite signs.
            mean = FieldFlow.of(few, targets, (forward.heads + backward.heads) / 2)
            return FieldFlow.of(points, targets, fused([*flows, mean]))

    def heads(self, scene: Scene, decision: Decision) -> Heads:
        """The fitted heads of the movers."""
        return cast(FieldFlow, decision.moving).heads[decision.is_moving]


def fused(flows: Sequence[FieldFlow]) -> Heads:
    """Fuses flows with weights learned for each object.

    The weights w of an object minimize the sum of w_k D_k plus a constant times their negative
    entropy, D_k being the residual of flow k: this is a softmax of the residuals.
    """
    residuals = np.stack([flow.loss for flow in flows])
    weights = np.exp((residuals.min(axis=0) - residuals) / _FUSION_M)
    weights /= weights.sum(axis=0)
    heads = np.stack([flow.heads for flow in flows])
    return np.asarray((weights[:, :, None, None] * heads).sum(axis=0), np.float64)


def _best(flows: Sequence[FieldFlow]) -> Heads:
    """(K, 3, 3) for each object the heads that leave the least residual, the first if in doubt."""
    best = np.argmin([flow.loss for flow in flows], axis=0)
    return np.stack([flow.heads for flow in flows])[best, np.arange(len(best))]
