# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The steps that warm networks take for one triplet: their points, their losses, their flow."""

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import torch
from numpy.typing import NDArray

from mnsf_ros.core.compute_device import compute_device, on_device
from mnsf_ros.core.flow_estimate import OptimizationResult, StageClock
from mnsf_ros.core.optimization import Schedule
from mnsf_ros.core.target_distance import TargetDistance
from mnsf_ros.core.warm_networks import WarmNetworks
from mnsf_ros.errors import OptimizationError
from mnsf_ros.objects.object_points import ObjectPoints
from mnsf_ros.objects.scene import Scene
from mnsf_ros.objects.target import Target
from mnsf_ros.settings import Settings

# Below this distance plus the spacing of the points, a pull fades with the distance: between two
# sweeps points of the same surface are apart by so much.
_FADING_M: Final = 0.1
# Share of the time budget after which the forward and the backward field are done.
_FORWARD_DONE, _FIELDS_DONE = 0.4, 0.8


@dataclass(frozen=True, eq=False)
class _Pull:
    """Another sweep that pulls P points toward its surfaces.

    Attributes:
        distance: D(p, S).
        rotation: (3, 3) from the axes of the world to the sensor frame of the sweep.
        shift: (3,) metres.
        steps: (P, 1) how often a point has made the motion that is fitted by then.
        weight: Of its loss.
    """

    distance: TargetDistance
    rotation: torch.Tensor
    shift: torch.Tensor
    steps: torch.Tensor
    weight: float

    def loss(
        self, points: torch.Tensor, flow: torch.Tensor, widths: torch.Tensor, chosen: torch.Tensor
    ) -> torch.Tensor:
        """Mean robust distance of some of the points, moved by a flow.

        Args:
            points: (B, 3) metres, axes of the world.
            flow: (B, 3) metres, likewise.
            widths: (B,) metres, below which the pull fades.
            chosen: (B,) their numbers.
        """
        moved = (points + self.steps[chosen] * flow) @ self.rotation.T + self.shift
        distances = self.distance(moved)
        fading = distances.square() / (2 * widths)
        return self.weight * torch.where(distances < widths, fading, distances - widths / 2).mean()


class LiveFit:
    """Fits warm networks to the points that may move in the current sweep of a scene.

    Everything is in the axes of the world with the sensor in the middle: what is learned of a place
    beside the robot holds while the robot turns.

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
        self._rows = networks.encoded(self._points)
        # A few points of each object tell its mean flow.
        self._few = objects.thinner()
        self._few_rows = networks.encoded(self._tensor(self._few.positions @ self._axes.T))
        self._widths = self._tensor(objects.spacing + _FADING_M)
        self._next, *before = scene.targets.near
        self._previous: Target | None = before[0] if before else None
        self._started_s = time.monotonic()

    def run(self, clock: StageClock) -> NDArray[np.float32]:
        """Fits the three networks and returns (K, 3) metres to t+1, the mean flow of each object.

        Raises:
            OptimizationError: If a loss or the flow is not finite.
            CancelledError: If `cancelled` says so.
        """
        expected, previous = self._motions(), self._previous
        with clock.stage("forward"):
            self._fit_field("forward", [self._pull(self._next, 1.0, expected)], _FORWARD_DONE)
        if previous is not None:
            with clock.stage("backward"):
                sweeps = (previous, *self._scene.targets.past)
                pulls = [self._pull(sweep, previous.steps, expected) for sweep in sweeps]
                self._fit_field("backward", pulls, _FIELDS_DONE)
            with clock.stage("fusion"):
                sweeps = (self._next, previous, *self._scene.targets.past)
                self._fit_fusion([self._pull(sweep, 1.0, expected) for sweep in sweeps])
        self._networks.num_fits += 1
        motions = self._motions()
        if not np.isfinite(motions).all():
            raise OptimizationError("the flow is not finite; try a smaller learning rate")
        return motions

    @property
    def _ratio(self) -> float | None:
        """Time to t+1 over time from t-1; None without a previous sweep."""
        return None if self._previous is None else -1.0 / self._previous.steps

    def _motions(self) -> NDArray[np.float32]:
        """(K, 3) metres, sensor axes, what the networks say by now."""
        flow = self._networks.flow(self._few_rows, self._ratio).cpu().numpy() @ self._axes
        sums = self._few.sums(flow.astype(np.float32))
        return np.asarray(sums / self._few.counts[:, None], np.float32)

    def _pull(self, target: Target, unit: float, motions: NDArray[np.float32]) -> _Pull:
        """The pull of a target on a motion that takes `unit` times the time to the next sweep."""
        steps = np.broadcast_to(target.steps_of(self._objects, motions), (len(motions), 1))
        rotation = target.from_current[:3, :3] @ self._axes.T
        return _Pull(
            self._distance_to(target),
            self._tensor(rotation),
            self._tensor(target.from_current[:3, 3]),
            self._tensor(steps[self._objects.owners] / unit),
            # Each sweep pulls as hard, however far away it is.
            abs(unit / target.steps),
        )

    def _fit_field(self, stage: str, pulls: Sequence[_Pull], done: float) -> None:
        """Some steps of a field on its targets."""
        network = self._networks.networks[stage]

        def loss_of() -> torch.Tensor:
            chosen = self._chosen()
            return self._loss(pulls, network(self._rows[chosen]), chosen)

        number = self._settings.optimization.max_iterations
        self.fits[stage] = self._networks.fit(stage, loss_of, self._schedule(number, done))

    def _fit_fusion(self, pulls: Sequence[_Pull]) -> None:
        """Some steps of the fusion, with both flows fixed, on all targets."""
        networks, network = self._networks, self._networks.networks["fusion"]

        def loss_of() -> torch.Tensor:
            chosen = self._chosen()
            flows = networks.flows(self._rows[chosen], self._ratio)
            return self._loss(pulls, network(flows), chosen)

        number = self._settings.fusion.max_iterations
        self.fits["fusion"] = self._networks.fit("fusion", loss_of, self._schedule(number, 1.0))

    def _loss(
        self, pulls: Sequence[_Pull], flow: torch.Tensor, chosen: torch.Tensor
    ) -> torch.Tensor:
        points, widths = self._points[chosen], self._widths[chosen]
        return torch.stack([pull.loss(points, flow, widths, chosen) for pull in pulls]).sum()

    def _chosen(self) -> torch.Tensor:
        """Numbers of the points of one step."""
        wanted, number = self._settings.optimization.max_points, len(self._points)
        if 0 < wanted < number:
            chosen = self._networks.random.integers(0, number, wanted)
            return torch.from_numpy(chosen).to(self._device)
        return torch.arange(number, device=self._device)

    def _schedule(self, iterations: int, done: float) -> Schedule:
        """Steps of one network, which end at a share of the time budget."""
        settings = self._settings.optimization
        is_fresh = self._networks.num_fits == 0
        return Schedule(
            max_iterations=self._settings.live.first_iterations if is_fresh else iterations,
            learning_rate=settings.learning_rate,
            deadline=self._started_s + done * (settings.time_budget_ms / 1e3 or math.inf),
            cancelled=self._cancelled,
            # Each step has other points.
            records_steps=False,
            keep_best=False,
        )

    def _tensor(self, array: NDArray[np.floating]) -> torch.Tensor:
        return on_device(np.ascontiguousarray(array, np.float32), self._device)
