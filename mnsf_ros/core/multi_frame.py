"""MNSF: from three sweeps to the flow of the middle one, one line per step of the paper."""

from __future__ import annotations

from collections.abc import Callable, Mapping

from mnsf_ros.core.compute_device import compute_device, limit_threads
from mnsf_ros.core.estimation_run import EstimationRun
from mnsf_ros.core.flow_estimate import FlowEstimate
from mnsf_ros.core.prepared_sweep import SweepPreparation
from mnsf_ros.core.scene_flow_estimator import MethodTraits, never
from mnsf_ros.core.warm_start import WarmStart
from mnsf_ros.settings import Settings, SettingValue
from mnsf_ros.sweeps.sweep import SweepTriplet


class MultiFrameEstimator:
    """Estimates scene flow from triplets, each starting where the last one ended.

    Not for use from several threads at once.
    """

    def __init__(
        self,
        settings: Settings,
        num_sweeps: int = 3,
        fixed: Mapping[str, SettingValue] | None = None,
    ) -> None:
        """Makes an estimator that has seen nothing yet.

        Args:
            settings: How to estimate.
            num_sweeps: Sweeps in all: a forward field and `num_sweeps` - 2 backward ones. With
                2 the forward flow goes through the fusion alone.
            fixed: Settings that make the variant, whatever the others are.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        self._fixed = dict(fixed or {})
        self.settings = settings.changed(self._fixed)
        self.traits = MethodTraits(num_sweeps, carries_state=settings.warm_start.enabled)
        self._device = compute_device(settings.compute)
        self._preparation = SweepPreparation(settings)
        self._warm_start = WarmStart()

    def with_settings(self, settings: Settings) -> MultiFrameEstimator:
        """An estimator with other settings that takes over what still holds.

        Raises:
            SettingsError: If the settings ask for a device that is not there.
        """
        other = MultiFrameEstimator(settings, self.traits.num_sweeps, self._fixed)
        old, settings = self.settings, other.settings
        if settings.compute == old.compute:
            if _networks(settings) == _networks(old):
                other._warm_start = self._warm_start
            preparing = (settings.crop, settings.ground, settings.distance)
            if preparing == (old.crop, old.ground, old.distance):
                other._preparation = self._preparation
        return other

    def estimate(
        self, triplet: SweepTriplet, cancelled: Callable[[], bool] = never
    ) -> FlowEstimate:
        """Estimates the flow of the triplet's current sweep (section 3 of the paper).

        Where three sweeps are wanted and there is no previous one, the forward flow alone is the
        result, which is FNSF.

        Args:
            triplet: Three sweeps, or two if `previous` is None, each in its own sensor frame.
                With more than three in all, `earlier` has the others.
            cancelled: Asked again and again; True ends the estimate with CancelledError.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep, or there are
                too few sweeps.
            OptimizationError: If the optimization finds no finite flow.
            CancelledError: If `cancelled` says so.
        """
        limit_threads(self.settings.compute)
        run = EstimationRun(
            triplet=triplet,
            settings=self.settings,
            device=self._device,
            preparation=self._preparation,
            warm_start=self._warm_start,
            cancelled=cancelled,
            num_sweeps=self.traits.num_sweeps,
        )
        if run.is_pair:
            return run.finish(run.forward_flow())
        forward_flow, *backward_flows = run.field_flows()
        inverted_flows = run.inverted_flows(backward_flows)
        fused_flow = run.fused_flow([forward_flow, *inverted_flows])
        self._warm_start.keep(run.learners, triplet)
        return run.finish(fused_flow)


def _networks(settings: Settings) -> tuple[object, ...]:
    """What must be the same for networks to be carried over."""
    # In another frame the flow is another one.
    is_removed = settings.ego_motion.removed
    return settings.field, settings.fusion, settings.optimization.joint, is_removed
