# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""Interface of all scene flow methods, also of other packages."""

from collections.abc import Callable
from typing import Any, Final, Protocol, runtime_checkable

from mnsf_ros.core.flow_estimate import Effort, FlowEstimate
from mnsf_ros.core.method_traits import MethodTraits as MethodTraits  # noqa: PLC0414 - of methods
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

# Triplets that wait in order for their preparation: each costs that of one sweep, while after a gap
# three sweeps have to be prepared. With two, a preparation that takes longer than the interval of
# the sweeps by a fifth leaves half of the flows; with none, a quarter.
NUM_PREPARED_IN_ORDER: Final = 2


def never() -> bool:
    """Default of `cancelled`: the estimate is never cancelled."""
    return False


class SceneFlowEstimator(Protocol):
    """Estimates the flow of the middle sweep of a triplet. Not for several threads at once.

    It lives for one stretch of a stream: its triplets come in the order of time, and each may build
    on those before. Where the stream breaks, and when a setting changes, a renewed one goes on.

    A method can do a part of its work ahead of an estimate, see `PreparingEstimator`.
    """

    @property
    def settings(self) -> Settings:
        """How it estimates."""
        ...

    @property
    def traits(self) -> MethodTraits:
        """Its needs, and how its estimates depend on each other."""
        ...

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of `triplet.current`.

        Args:
            triplet: Three sweeps in their own sensor frames; `earlier` has more, where the method
                needs them.
            cancelled: Asked again and again; True ends the estimate with CancelledError.

        Returns:
            The flow, one row for each point of the current sweep.

        Raises:
            MnsfError: If there is no flow for this triplet; the next one is tried all the same.
            CancelledError: If `cancelled` returns True.
        """
        ...

    def renewed(self, settings: Settings) -> "SceneFlowEstimator":
        """Returns an estimator with these settings that has seen no sweep yet.

        It may take over what does not depend on sweeps, such as loaded weights. An estimate of this
        one may be under way.

        Raises:
            SettingsError: If the method cannot work with the settings.
        """
        ...


@runtime_checkable
class PreparingEstimator(SceneFlowEstimator, Protocol):
    """A method with work that each sweep needs once, whatever becomes of its triplets.

    `prepare` may run in one thread while `estimate` runs in another one for an earlier triplet; all
    that they share is what the one returns and the other gets. Everything else is for one thread
    at a time.
    """

    def prepare(self, triplet: SweepTriplet) -> Any:  # noqa: ANN401 - known to the method only
        """Prepares the new sweeps of a triplet, and returns the prepared triplet.

        It is called for each triplet in the order of the stamps, also for those that are dropped
        afterwards. What it returns must not change any more.

        Raises:
            MnsfError: If there is no flow for this triplet; the next one is tried all the same.
        """
        ...

    def estimate(
        self,
        triplet: SweepTriplet,
        cancelled: Callable[[], bool] = never,
        prepared: Any = None,  # noqa: ANN401 - as above
        effort: Effort = Effort.FULL,
    ) -> FlowEstimate:
        """Estimates the flow of a prepared triplet, like `estimate` of every method.

        The flow is the same if nobody has prepared it: None stands for that, and the method
        prepares it first. Under load `effort` is lower: the method leaves out what it can.
        """
        ...
