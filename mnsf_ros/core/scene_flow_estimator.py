"""What every method of estimating scene flow offers, ours and those of other packages."""

from __future__ import annotations

from typing import Protocol

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.sweeps.sweep import SweepTriplet


def never() -> bool:
    """Abandons no estimate: what estimators are asked for unless somebody may close them."""
    return False


class SceneFlowEstimator(Protocol):
    """Estimates the flow of the middle sweep of a triplet.

    An estimator may have an attribute `num_sweeps`, the number of sweeps that it looks at.
    """

    def estimate(self, triplet: SweepTriplet) -> FlowEstimate:
        """Estimates the flow of `triplet.current`.

        Args:
            triplet: Three sweeps in their own sensor frames; `earlier` has more, where the method
                asked for them.

        Returns:
            The flow, one row for each point of the current sweep.

        Raises:
            MnsfError: If there is no flow for this triplet; the next one is tried all the same.
        """
        ...
