"""One estimate of the paper's method under way: its networks and schedules, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import torch

from mnsf_ros.core.flow_estimate import FlowEstimate, Start
from mnsf_ros.core.forward_backward_fields import fit_field, fit_jointly, still_fits
from mnsf_ros.core.motion_inversion import invert_motion
from mnsf_ros.core.optimization import Learner
from mnsf_ros.core.prepared_sweep import PreparedSweep, SweepPreparation
from mnsf_ros.core.schedule import Schedule, Schedules
from mnsf_ros.core.warm_start import Learners, WarmStart
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet

_TRIPLET = 3


class EstimationRun:
    """The stages of one estimate. Make it, call the stages in order, then `finish`.

    Attributes:
        learners: The networks, carried over from the last triplet or fresh.
        is_pair: Whether the previous sweep of a triplet is missing.
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
        num_sweeps: int = 3,
    ) -> None:
        """Prepares the sweeps, chooses the points to fit to and where to start from.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep, or there are
                too few sweeps.
        """
        self._settings = settings
        self._num_fields = num_sweeps - 1
        self.is_pair = triplet.previous is None and num_sweeps == _TRIPLET
        num_before = 0 if self.is_pair else num_sweeps - 2
        self._bench = Workbench(triplet, settings, device, preparation, num_before)
        with self._bench.stage("prepare"):
            self._start = self._choose_start(triplet, warm_start)
        self._schedules = Schedules.start_now(
            settings, is_warm=self._start is Start.WARM, cancelled=cancelled
        )

    def forward_flow(self) -> torch.Tensor:
        """Fits g_f alone; (N, 3) finite metres, from t to t+1."""
        return self._field_flow(
            "forward", self.learners.forward, self._bench.next, self._schedules.forward
        )

    def field_flows(self) -> list[torch.Tensor]:
        """Fits g_f and each g_b; (N, 3) finite metres each, to t+1, t-1, t-2 ..."""
        targets = [self._bench.next, *self._bench.before]
        fields = self.learners.fields
        if self._settings.optimization.joint:
            self._fit_jointly(targets)
            return [self._bench.flow("fields", field.network) for field in fields]
        stages = ["forward", "backward", *(f"backward {k}" for k in range(2, len(fields)))]
        schedules = self._schedules.fields(len(fields))
        keep_best = self._settings.fusion.fields == "best"
        return [
            self._field_flow(*each, keep_best=keep_best)
            for each in zip(stages[: len(fields)], fields, targets, schedules, strict=True)
        ]

    def inverted_flows(self, backward_flows: Sequence[torch.Tensor]) -> list[torch.Tensor]:
        """Turns flows to t-1, t-2 ... into flows to t+1, or not, to see what that is worth."""
        if not self._settings.fusion.inversion:
            return list(backward_flows)
        ratios = self._bench.triplet.interval_ratios[: len(backward_flows)]
        return [
            invert_motion(flow, ratio) for flow, ratio in zip(backward_flows, ratios, strict=True)
        ]

    def fused_flow(self, flows: Sequence[torch.Tensor]) -> torch.Tensor:
        """Fits g_fusion to f and f' ..., each (N, 3); (N, 3) finite metres, from t to t+1."""
        return self._bench.fused_flow(self.learners.fusion, flows, self._schedules.fusion)

    def finish(self, flow: torch.Tensor) -> FlowEstimate:
        """Makes the result of the (N, 3) flow."""
        return self._bench.finish(flow, self._start)

    def _choose_start(self, triplet: SweepTriplet, warm_start: WarmStart) -> Start:
        carried, start = warm_start.carried(triplet, self._settings)
        # Until the estimate is complete, its half-fitted networks are no start for the next one.
        warm_start.forget()
        if carried and self._still_fits(carried.forward):
            self.learners = carried
            return Start.WARM
        bench = self._bench
        self.learners = Learners.fresh(
            self._settings, bench.generator, bench.device, self._num_fields
        )
        return Start.COLD_LOSS if carried else start

    def _still_fits(self, forward: Learner) -> bool:
        ratio, bench = self._settings.warm_start.max_loss_ratio, self._bench
        # A cold start after this must not differ from any other: give back what was drawn.
        state = bench.generator.get_state()
        fits = still_fits(forward, bench.points, bench.next.distance, ratio)
        bench.generator.set_state(state)
        return fits

    def _field_flow(
        self,
        stage: str,
        field: Learner,
        target: PreparedSweep,
        schedule: Schedule,
        *,
        keep_best: bool = True,
    ) -> torch.Tensor:
        bench = self._bench
        with bench.stage(stage):
            bench.fits[stage] = fit_field(
                field, bench.points, target.distance, schedule, keep_best=keep_best
            )
        return bench.flow(stage, field.network)

    def _fit_jointly(self, targets: Sequence[PreparedSweep]) -> None:
        bench = self._bench
        with bench.stage("fields"):
            bench.fits["fields"] = fit_jointly(
                self.learners.fields,
                bench.points,
                [target.distance for target in targets],
                self._schedules.fields(1)[0],
                keep_best=self._settings.fusion.fields == "best",
            )
