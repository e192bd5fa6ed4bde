"""What every method of estimating scene flow offers, ours and those of other packages."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet


def never() -> bool:
    """The `cancelled` of an estimate that nobody cancels."""
    return False


@dataclass(frozen=True)
class MethodTraits:
    """What a method says of itself, with the settings that it has.

    Attributes:
        num_sweeps: Sweeps that the method looks at: 2 are current and next, 3 the previous, too.
        carries_state: Whether an estimate depends on the ones before it. Such a method must get
            its triplets in order and without gaps, and an interrupted run starts again.
        needs_poses: Whether `triplet.next_from_current` must be known.
        is_reference: Whether it is a row to compare with, such as zero flow, and no rival.
        is_external: Whether it is another program or its files. Such a method is not warmed up,
            and does not estimate again just for a picture.
        is_timed: False if its run time says nothing, as for predictions read from files.
    """

    num_sweeps: int = 2
    carries_state: bool = False
    needs_poses: bool = False
    is_reference: bool = False
    is_external: bool = False
    is_timed: bool = True


class SceneFlowEstimator(Protocol):
    """Estimates the flow of the middle sweep of a triplet. Not for several threads at once."""

    @property
    def settings(self) -> Settings:
        """How it estimates."""
        ...

    @property
    def traits(self) -> MethodTraits:
        """What it needs and how its estimates depend on each other."""
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

    def with_settings(self, settings: Settings) -> SceneFlowEstimator:
        """Returns an estimator with other settings that keeps what is still valid.

        That may be networks, a map or poses. This estimator must not be used afterwards.

        Raises:
            SettingsError: If the method cannot work with the settings.
        """
        ...
