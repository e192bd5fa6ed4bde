"""One estimate under way: its sweeps, networks, schedules and clock, stage by stage."""

from __future__ import annotations

from collections.abc import Callable

import torch

from mnsf_ros.core.batches import Batches, evaluate
from mnsf_ros.core.flow_estimate import FlowEstimate, StageClock, Start
from mnsf_ros.core.forward_backward_fields import fit_field, still_fits
from mnsf_ros.core.optimization import Learner, OptimizationResult
from mnsf_ros.core.prepared_sweep import PreparedSweep, SweepPreparation
from mnsf_ros.core.schedule import Schedule, Schedules
from mnsf_ros.core.temporal_fusion import fit_fusion
from mnsf_ros.core.warm_start import Learners, WarmStart
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet


class EstimationRun:
    """The stages of one estimate. Make it, call the stages in order, then `finish`.

    Attributes:
        learners: The three networks, carried over from the last triplet or fresh.
    """

    learners: Learners

    def __init__(
        self,
        *,
        triplet: SweepTriplet,
        settings: Settings,
        device: torch.device,
        preparation: SweepPreparation,
        warm_start: WarmStart,
        cancelled: Callable[[], bool],
    ) -> None:
        """Prepares the sweeps, chooses the points to fit to and where to start from.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep.
        """
        self._settings = settings
        self._device = device
        self._clock = StageClock(device)
        self._fits: dict[str, OptimizationResult] = {}
        # A generator of its own: the same triplet gives the same flow whatever came before.
        self._generator = torch.Generator().manual_seed(settings.compute.seed)
        with self._clock.stage("prepare"):
            self._prepare_sweeps(triplet, preparation)
            self._start = self._choose_start(triplet, warm_start)
        self._schedules = Schedules.start_now(
            settings, is_warm=self._start is Start.WARM, cancelled=cancelled
        )

    def forward_flow(self) -> torch.Tensor:
        """Fits g_f; (N, 3) metres, from t to t+1."""
        return self._field_flow(
            "forward", self.learners.forward, self._next, self._schedules.forward
        )

    def backward_flow(self) -> torch.Tensor:
        """Fits g_b; (N, 3) metres, from t to t-1."""
        return self._field_flow(
            "backward", self.learners.backward, self._previous, self._schedules.backward
        )

    def fused_flow(self, forward_flow: torch.Tensor, inverted_flow: torch.Tensor) -> torch.Tensor:
        """Fits g_fusion to f and f', both (N, 3); (N, 3) metres, from t to t+1."""
        with self._clock.stage("fusion"):
            both_flows = torch.cat([forward_flow, inverted_flow], dim=1)  # [N, 6]
            rows = torch.cat([self._current.positions, both_flows], dim=1)[self._to_fit]  # [M, 9]
            fusion = self.learners.fusion
            self._fits["fusion"] = fit_fusion(
                fusion, self._batches(rows), self._next.distance, self._schedules.fusion
            )
            return evaluate(fusion.network, both_flows)

    def finish(self, flow: torch.Tensor) -> FlowEstimate:
        """Makes the result of the (N, 3) flow."""
        return FlowEstimate(
            flow=flow.cpu().numpy(),
            kept=self._current.kept,
            times_ms=self._clock.times_ms,
            fits=self._fits,
            start=self._start,
            device=self._device.type,
            distance_kind=self._next.distance.kind,
        )

    def _prepare_sweeps(self, triplet: SweepTriplet, preparation: SweepPreparation) -> None:
        sweeps = [triplet.current, triplet.next, triplet.previous or triplet.current]
        self._current, self._next, self._previous = preparation.prepare(*sweeps)
        kept = torch.from_numpy(self._current.kept).nonzero().view(-1)
        wanted = self._settings.optimization.max_points
        if 0 < wanted < len(kept):
            kept = kept[torch.randperm(len(kept), generator=self._generator)[:wanted]]
        self._to_fit = kept.to(self._device)
        self._points = self._batches(self._current.positions[self._to_fit])

    def _choose_start(self, triplet: SweepTriplet, warm_start: WarmStart) -> Start:
        carried, start = warm_start.carried(triplet, self._settings)
        # Until the estimate is complete, its half-fitted networks are no start for the next one.
        warm_start.forget()
        if carried and self._still_fits(carried.forward):
            self.learners = carried
            return Start.WARM
        self.learners = Learners.fresh(self._settings, self._generator, self._device)
        return Start.COLD_LOSS if carried else start

    def _still_fits(self, forward: Learner) -> bool:
        ratio = self._settings.warm_start.max_loss_ratio
        return still_fits(forward, self._points, self._next.distance, ratio)

    def _field_flow(
        self, stage: str, field: Learner, target: PreparedSweep, schedule: Schedule
    ) -> torch.Tensor:
        with self._clock.stage(stage):
            self._fits[stage] = fit_field(field, self._points, target.distance, schedule)
            return evaluate(field.network, self._current.positions)

    def _batches(self, rows: torch.Tensor) -> Batches:
        return Batches(rows, self._settings.optimization.batch_points, self._generator)
