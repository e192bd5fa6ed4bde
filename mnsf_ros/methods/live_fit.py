# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The steps that warm networks take for one triplet: their points, their losses, their flow."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import cycle, islice
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.arrays import Floats32
from mnsf_ros.core.compute_device import compute_device, on_device
from mnsf_ros.core.flow_estimate import OptimizationResult
from mnsf_ros.core.stage_clock import StageClock
from mnsf_ros.errors import OptimizationError
from mnsf_ros.networks.optimization import Schedule
from mnsf_ros.networks.target_distance import TargetDistance
from mnsf_ros.networks.warm_networks import WarmNetworks
from mnsf_ros.online.object_points import ObjectPoints
from mnsf_ros.online.preparation import Scene
from mnsf_ros.online.target import Target
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import USUAL_INTERVAL_S

# Below this distance plus the spacing of the points, a pull fades with the distance: between two
# sweeps points of the same surface are apart by so much.
_FADING_M: Final = 0.1
# Share of the time budget after which the forward and the backward field are done.
_FORWARD_DONE, _FIELDS_DONE = 0.4, 0.8


@dataclass(frozen=True, eq=False)
class _Pull:
    """Another sweep that pulls P points toward its surfaces, with a Huber loss of D(p, S)."""

    distance: TargetDistance  # D(p, S)
    rotation: torch.Tensor  # (3, 3) from the axes of the world to the sensor frame of the sweep
    shift: torch.Tensor  # (3,) metres
    time_ratios: torch.Tensor  # (P, 1) factor from the fitted flow to the motion until the sweep
    weight: float  # of its loss

    def of(
        self, points: torch.Tensor, flow: torch.Tensor, widths: torch.Tensor, chosen: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor]:
        """Mean Huber loss of some of the points, moved by a flow, and its gradient.

        Args:
            points: (B, 3) metres, axes of the world.
            flow: (B, 3) metres, likewise, without gradient.
            widths: (B,) metres, from where on the loss is linear.
            chosen: (B,) rows of these points in `time_ratios`.

        Returns:
            The loss, a scalar, and its gradient with respect to the flow, (B, 3).
        """
        time_ratios = self.time_ratios[chosen]
        moved = torch.addmm(self.shift, points + time_ratios * flow, self.rotation.T)
        distances, directions = self.distance.with_gradient(moved)
        # The slope of the loss: 1 from the width on, less below.
        slopes = (distances / widths).clamp(max=1.0)
        loss = (slopes * (distances - slopes * widths / 2)).mean()
        factors = time_ratios * slopes[:, None] * (self.weight / len(points))
        return self.weight * loss, factors * (directions @ self.rotation)


class _Pulls:
    """The pulls on one flow: at each step the near ones and one of the older ones, in turn."""

    def __init__(self, near: Sequence[_Pull], older: Sequence[_Pull]) -> None:
        self._near, self._older = near, cycle(older)

    def of_a_step(self) -> list[_Pull]:
        """The pulls of the next step."""
        return [*self._near, *islice(self._older, 1)]


class LiveFit:
    """Fits warm networks to the points that may move in the current sweep of a scene.

    Everything is in the axes of the world with the sensor in the middle, and flow is in metres for
    the usual interval: what was learned holds where the robot turns, and where a sweep is dropped.

    Attributes:
        fits: Stage to result.
    """

    def __init__(
        self,
        networks: WarmNetworks,
        objects: ObjectPoints,
        scene: Scene,
        distance_to: Callable[[Target], TargetDistance],
        settings: Settings,
        cancelled: Callable[[], bool],
    ) -> None:
        """Takes the points of K objects; `distance_to` gives D(p, S) of a target."""
        self.fits: dict[str, OptimizationResult] = {}
        self._networks, self._objects, self._scene = networks, objects, scene
        self._distance_to, self._settings, self._cancelled = distance_to, settings, cancelled
        self._device = compute_device(settings.compute)
        self._axes = scene.current.pose.world_from_sensor[:3, :3]
        self._points = self._tensor(objects.positions @ self._axes.T)
        self._inputs = networks.encoded(self._points)
        # The mean flow of an object is computed at a few of its points.
        self._few = objects.thinner()
        self._few_inputs = networks.encoded(self._tensor(self._few.positions @ self._axes.T))
        self._widths = self._tensor(objects.spacing + _FADING_M)
        self._next, self._previous = scene.targets.next, scene.targets.previous
        self._usual_intervals = scene.usual_interval_s / USUAL_INTERVAL_S
        self._start: Floats32 = np.zeros((len(objects), 3), np.float32)
        self._started_s = time.monotonic()

    def run(self, clock: StageClock) -> Floats32:
        """Fits the three networks and returns (K, 3) metres to t+1, the mean flow of each object.

        Raises:
            OptimizationError: If a loss or the flow is not finite.
            CancelledError: If `cancelled` says so.
        """
        self._start = self._motions()
        with clock.stage("forward"):
            share = 1.0 if self._previous is None else _FORWARD_DONE
            self._fit("forward", self._pulls([self._next], []), share)
        if self._previous is not None:
            near, past = self._previous, self._scene.targets.past
            with clock.stage("backward"):
                self._fit("backward", self._pulls([near], past, is_backward=True), _FIELDS_DONE)
            with clock.stage("fusion"):
                self._fit("fusion", self._pulls([self._next, near], past), 1.0)
        motions = self._motions()
        if not np.isfinite(motions).all():
            raise OptimizationError("the flow is not finite; try a smaller learning rate")
        return motions

    def _motions(self) -> Floats32:
        """(K, 3) metres, sensor axes, mean flow of each object by the current networks."""
        has_backward = self._previous is not None and "backward" in self._networks.fitted
        flow = self._networks.flow(self._few_inputs, has_backward=has_backward)
        in_interval = self._usual_intervals * flow.cpu().numpy() @ self._axes
        sums = self._few.sums(in_interval.astype(np.float32))
        return np.asarray(sums / self._few.counts[:, None], np.float32)

    def _pulls(
        self, near: Sequence[Target], older: Sequence[Target], *, is_backward: bool = False
    ) -> _Pulls:
        """The pulls of targets on a flow, which is forward or backward."""
        unit = -self._usual_intervals if is_backward else self._usual_intervals
        return _Pulls(*([self._pull(target, unit) for target in some] for some in (near, older)))

    def _pull(self, target: Target, unit: float) -> _Pull:
        """The pull on a flow.

        `unit` is the time to the next sweep in usual intervals, negative for the backward flow.
        """
        time_ratios = target.time_ratios_of(self._objects, self._start) * unit
        of_points = np.broadcast_to(time_ratios, (len(self._objects), 1))[self._objects.owners]
        return _Pull(
            self._distance_to(target),
            self._tensor(target.from_current[:3, :3] @ self._axes.T),
            self._tensor(target.from_current[:3, 3]),
            self._tensor(of_points),
            # Each sweep pulls as hard, however far away it is.
            1.0 / abs(target.time_ratio * unit),
        )

    def _fit(self, stage: str, pulls: _Pulls, share_of_budget: float) -> None:
        """Some steps of a network, each with other points, within a share of the time budget."""
        flow_of = self._fused if stage == "fusion" else self._networks.networks[stage]

        def loss_of() -> torch.Tensor:
            chosen = self._chosen()
            flow = flow_of(self._inputs[chosen])
            points, widths = self._points[chosen], self._widths[chosen]
            # By hand: autograd would take longer for the many small operations of a pull.
            results = [pull.of(points, flow.detach(), widths, chosen) for pull in pulls.of_a_step()]
            losses, gradients = zip(*results, strict=True)
            loss, gradient = torch.stack(losses).sum(), torch.stack(gradients).sum(dim=0)
            # A stand-in with the value and the gradient of the loss.
            return loss + (gradient * (flow - flow.detach())).sum()

        self.fits[stage] = self._networks.fit(
            stage, loss_of, self._schedule(stage, share_of_budget)
        )

    def _fused(self, inputs: torch.Tensor) -> torch.Tensor:
        """The fused flow at encoded positions; f and f' are fixed."""
        flows = self._networks.flows(inputs)
        fused: torch.Tensor = self._networks.networks["fusion"](flows)
        return fused

    def _chosen(self) -> torch.Tensor:
        """Numbers of the points of one step."""
        wanted, number = self._settings.optimization.max_points, len(self._points)
        if 0 < wanted < number:
            chosen = self._networks.random.integers(0, number, wanted)
            return torch.from_numpy(chosen).to(self._device)
        return torch.arange(number, device=self._device)

    def _schedule(self, stage: str, share_of_budget: float) -> Schedule:
        """Steps of one network."""
        settings = self._settings.optimization
        limits = self._settings.fusion if stage == "fusion" else settings
        is_fresh = stage not in self._networks.fitted
        return Schedule(
            max_iterations=(
                self._settings.live.first_iterations if is_fresh else limits.max_iterations
            ),
            learning_rate=settings.learning_rate,
            deadline=self._started_s
            + share_of_budget * (settings.time_budget_ms / 1e3 or math.inf),
            cancelled=self._cancelled,
            # Each step has other points.
            records_steps=False,
            keep_best=False,
        )

    def _tensor(self, array: NDArray[np.floating]) -> torch.Tensor:
        return on_device(np.ascontiguousarray(array, np.float32), self._device)
