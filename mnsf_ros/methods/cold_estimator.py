"""An estimator around one function that fits fresh networks to each triplet."""

from __future__ import annotations

from collections.abc import Callable

import torch

from mnsf_ros.core.compute_device import compute_device, limit_threads
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.prepared_sweep import SweepPreparation
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.core.schedule import Schedules
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

FlowOf = Callable[[Workbench, Schedules], torch.Tensor]


class ColdEstimator:
    """Estimates scene flow from triplets, each by itself.

    Attributes:
        settings: How it estimates.
        traits: What the method needs.
    """

    def __init__(
        self,
        flow_of: FlowOf,
        settings: Settings,
        *,
        num_before: int = 0,
        distance_kind: str | None = None,
    ) -> None:
        """Makes an estimator.

        Args:
            flow_of: The method: fits networks on the workbench, by the schedules, and returns
                the flow (N, 3), metres from t to t+1.
            settings: How to estimate.
            num_before: Sweeps before the current one that the method needs.
            distance_kind: How the method measures distances, if not to `Workbench.next.distance`.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        self.traits = MethodTraits(num_before + 2)
        self._flow_of = flow_of
        self.settings = settings
        self._num_before = num_before
        self._distance_kind = distance_kind
        self._device = compute_device(settings.compute)
        self._preparation = SweepPreparation(settings)

    def with_settings(self, settings: Settings) -> ColdEstimator:
        """Returns an estimator with other settings; there is nothing to take over.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        return ColdEstimator(
            self._flow_of,
            settings,
            num_before=self._num_before,
            distance_kind=self._distance_kind,
        )

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep.

        Args:
            triplet: The sweeps, each in its own sensor frame.
            cancelled: Asked again and again; True ends the estimate with CancelledError.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep, or there are
                too few sweeps.
            OptimizationError: If the optimization finds no finite flow.
            CancelledError: If `cancelled` says so.
        """
        limit_threads(self.settings.compute)
        bench = Workbench(triplet, self.settings, self._device, self._preparation, self._num_before)
        schedules = Schedules.start_now(self.settings, is_warm=False, cancelled=cancelled)
        return bench.finish(self._flow_of(bench, schedules), distance_kind=self._distance_kind)
