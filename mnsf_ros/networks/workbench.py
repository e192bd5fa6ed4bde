# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The workbench of a method: prepared sweeps, randomness, a clock, and the fits so far."""

import math
import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import replace
from functools import cached_property
from typing import Final

import numpy as np
import torch
from torch import nn

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.compute_device import compute_device, layer_precision, on_device
from mnsf_ros.core.flow_estimate import FlowEstimate, OptimizationResult
from mnsf_ros.core.scene_flow_estimator import never
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.errors import OptimizationError, SweepError
from mnsf_ros.networks.networks import Perceptron, evaluate, fusion_network
from mnsf_ros.networks.optimization import LossOf, Schedule, minimize
from mnsf_ros.networks.target_distance import TargetDistance
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.kept_points import fit_mask
from mnsf_ros.sweeps.sweep import Sweep, SweepTriplet

# Share of the time budget for the fields; the rest is for the fusion.
_FIELDS_DONE: Final = 0.8


class PreparedSweep:
    """A prepared sweep. Built once, used as next, current and previous.

    Attributes:
        kept: (N,) bool, the points that fields are fitted to, see `fit_mask`.
        points: (M, 3) float32 on the device, metres, the kept points.
    """

    def __init__(self, sweep: Sweep, settings: Settings) -> None:
        """Chooses the points.

        Raises:
            SweepError: If too few points are left.
        """
        self._is_chosen = sweep.kept is not None
        self.kept = fit_mask(sweep, settings)
        self._xyz = sweep.xyz
        self._settings = settings.distance
        self.points = on_device(sweep.xyz[self.kept], compute_device(settings.compute))

    @cached_property
    def positions(self) -> torch.Tensor:
        """(P, 3) positions at which fields are evaluated: all points, or the kept ones if chosen.

        Networks do not extrapolate, so a cropped point takes the flow of the nearest place in the
        box around the kept points.
        """
        if self._is_chosen:
            return self.points
        low, high = self.points.min(dim=0).values, self.points.max(dim=0).values
        all_points = on_device(self._xyz, self.points.device)
        return torch.minimum(torch.maximum(all_points, low), high)

    @property
    def kept_positions(self) -> torch.Tensor:
        """(M,) indices of the kept points among `positions`, on the CPU."""
        if self._is_chosen:
            return torch.arange(len(self.points))
        return torch.from_numpy(self.kept).nonzero().view(-1)

    def whole(self, flow: torch.Tensor) -> Floats32:
        """Returns the flow (P, 3) at `positions` for all points (N, 3), NaN for others."""
        if not self._is_chosen:
            return flow.cpu().numpy()
        whole = np.full(self._xyz.shape, np.nan, dtype=np.float32)
        whole[self.kept] = flow.cpu().numpy()
        return whole

    @cached_property
    def distance(self) -> TargetDistance:
        """D(p, S) with this sweep as the target S."""
        return TargetDistance(self.points, self._settings)


class Workbench:
    """One estimate under way, for any method. Make it, fit networks, then `finish`."""

    current: PreparedSweep  # at t, whose flow is estimated
    next: PreparedSweep  # at t+1
    before: list[PreparedSweep]  # at t-1, t-2 ...
    points: torch.Tensor  # (M, 3) metres, of the current sweep, for fits

    def __init__(
        self,
        triplet: SweepTriplet,
        settings: Settings,
        prepared: dict[Sweep, PreparedSweep],
        num_before: int = 0,
        cancelled: Callable[[], bool] = never,
    ) -> None:
        """Prepares the current, the next and `num_before` earlier sweeps; chooses points to fit to.

        `prepared` has the sweeps prepared for the last triplet; these take their place.

        Raises:
            SweepError: If crop and ground removal leave too few points of a sweep, or there are
                too few sweeps for the method.
        """
        self.triplet = triplet
        self.settings = settings
        self.device = device = compute_device(settings.compute)
        self._cancelled = cancelled
        self._precision = ""
        self.fits: dict[str, OptimizationResult] = {}  # by stage
        is_on_gpu = device.type == "cuda"
        self._clock = StageClock(finish=torch.cuda.synchronize if is_on_gpu else lambda: None)
        # A generator of its own: the same triplet gives the same flow whatever came before.
        self.generator = torch.Generator().manual_seed(settings.compute.seed)
        with self.stage("prepare"):
            if len(triplet.before) < num_before:
                raise SweepError(
                    f"{triplet.current}: got {len(triplet.before)} sweeps before "
                    f"it, expected {num_before}"
                )
            sweeps = (triplet.current, triplet.next, *triplet.before[:num_before])
            ready = [prepared.get(sweep) or PreparedSweep(sweep, settings) for sweep in sweeps]
            prepared.clear()
            prepared.update(zip(sweeps, ready, strict=True))
            self.current, self.next, *self.before = ready
            self._indices_to_fit = self._sampled(self.current.kept_positions).to(device)
            self.points = self.current.positions[self._indices_to_fit]
        self._started_s = time.monotonic()

    def fresh_field(self, num_inputs: int = 3) -> Perceptron:
        """A fresh field of the paper, (M, num_inputs) to (M, 3) metres."""
        precision = layer_precision(self.settings.compute)
        field = Perceptron(self.settings.field, self.generator, num_inputs, precision)
        return field.to(self.device)

    def fresh_fusion(self, num_flows: int = 2) -> nn.Module:
        """A fresh fusion of flows, of the kind in the settings."""
        precision = layer_precision(self.settings.compute)
        fusion = fusion_network(self.settings.fusion, self.generator, num_flows, precision)
        return fusion.to(self.device)

    def field_schedules(self, number: int) -> tuple[Schedule, ...]:
        """Schedules of fields that are fitted one after the other, before the fusion."""
        return tuple(self.field_schedule(_FIELDS_DONE * (k + 1) / number) for k in range(number))

    def field_schedule(self, done: float = 1.0) -> Schedule:
        """Schedule of one field, which ends at a share of the time budget."""
        optimization, stopping = self.settings.optimization, self.settings.early_stopping
        return Schedule(
            max_iterations=optimization.max_iterations,
            learning_rate=optimization.learning_rate,
            decay=optimization.decay,
            patience=stopping.patience,
            min_delta_m=stopping.min_delta_m,
            deadline=self._started_s + done * (optimization.time_budget_ms / 1e3 or math.inf),
            cancelled=self._cancelled,
            records_steps=self.settings.compute.cuda_graphs,
        )

    def stage(self, name: str) -> AbstractContextManager[None]:
        """Adds the time of the block to the stage's time."""
        return self._clock.stage(name)

    def sampled_points(self, sweep: PreparedSweep) -> torch.Tensor:
        """(M, 3) metres, points of another sweep for fits."""
        return self._sampled(sweep.points)

    def fit(self, stage: str, network: nn.Module, loss_of: LossOf, schedule: Schedule) -> None:
        """Optimizes a network as `minimize`; time and result go under the name of the stage."""
        with self.stage(stage):
            self.fits[stage] = minimize(network, loss_of, schedule)

    def flow(
        self, stage: str, network: nn.Module, rows: torch.Tensor | None = None
    ) -> torch.Tensor:
        """Returns the flow of a fitted network, (P, 3) finite metres.

        Its input has a row for each position of the current sweep, by default the position.

        Raises:
            OptimizationError: If the flow is not finite.
        """
        with self.stage(stage):
            for part in network.modules():
                if isinstance(part, Perceptron):
                    self._precision = str(part.precision).removeprefix("torch.")
            rows = self.current.positions if rows is None else rows
            flow = evaluate(network, rows)
            # The loss may be finite: it is of the step before, or truncated.
            if not torch.isfinite(flow).all():
                raise OptimizationError(
                    f"the {stage} flow is not finite; try a smaller learning rate"
                )
            return flow

    def fused_flow(self, fusion: nn.Module, flows: Sequence[torch.Tensor]) -> torch.Tensor:
        """Fuses f and f' ..., each (P, 3), to (P, 3) finite metres, from t to t+1.

        Minimizes mean D(p + g_fusion(f, f'), S3); f and f' are fixed.
        """
        side_by_side = torch.cat(list(flows), dim=1)  # [N, 3 K]
        chosen = side_by_side[self._indices_to_fit]

        def loss_of() -> torch.Tensor:
            return self.next.distance.mean(self.points + fusion(chosen))

        settings = self.settings.fusion
        schedule = replace(
            self.field_schedule(),
            max_iterations=settings.max_iterations,
            patience=settings.patience,
        )
        self.fit("fusion", fusion, loss_of, schedule)
        return self.flow("fusion", fusion, side_by_side)

    def finish(self, flow: torch.Tensor, distance_kind: str | None = None) -> FlowEstimate:
        """Makes the result of the flow at the positions, (P, 3) metres from t to t+1.

        `distance_kind` is `grid`, `bricks` or `tree`, by default as of `next.distance`.
        """
        return FlowEstimate(
            flow=self.current.whole(flow),
            kept=self.current.kept,
            times_ms=self._clock.times_ms,
            fits=self.fits,
            device=self.device.type,
            distance_kind=distance_kind or self.next.distance.kind,
            precision=self._precision,
        )

    def _sampled(self, rows: torch.Tensor) -> torch.Tensor:
        wanted = self.settings.optimization.max_points
        if 0 < wanted < len(rows):
            chosen = torch.randperm(len(rows), generator=self.generator)[:wanted]
            return rows[chosen.to(rows.device)]
        return rows
