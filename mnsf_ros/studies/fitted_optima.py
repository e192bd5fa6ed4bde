"""The optima of both methods for one triplet, and the loss as a function of their weights."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import torch
from torch import nn

from mnsf_ros.core.compute_device import compute_device, limit_threads
from mnsf_ros.core.estimation_run import EstimationRun
from mnsf_ros.core.optimization import OptimizationResult
from mnsf_ros.core.prepared_sweep import SweepPreparation
from mnsf_ros.core.warm_start import WarmStart
from mnsf_ros.settings import Settings
from mnsf_ros.sweeps.sweep import SweepTriplet


class MultiFrameField(nn.Module):
    """The whole method as one network: (M, 3) points to their fused flow, (M, 3) metres."""

    def __init__(
        self, forward_field: nn.Module, backward_field: nn.Module, fusion: nn.Module, ratio: float
    ) -> None:
        """Takes fitted networks.

        Args:
            forward_field: g_f.
            backward_field: g_b.
            fusion: g_fusion.
            ratio: Interval to the next sweep over that from the previous one.
        """
        super().__init__()
        self._forward_field = forward_field
        self._backward_field = backward_field
        self._fusion = fusion
        self._ratio = ratio

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Flow at the points."""
        flows = (self._forward_field(points), -self._ratio * self._backward_field(points))
        fused: torch.Tensor = self._fusion(torch.cat(flows, dim=1))
        return fused


@dataclass(frozen=True, eq=False)
class FittedOptima:
    """Where both methods end.

    Attributes:
        losses: Each way to vary a method, to the weights and their loss.
        fits: Stage to how its optimization went.
    """

    losses: dict[str, tuple[nn.Module, Callable[[], torch.Tensor]]]
    fits: dict[str, OptimizationResult]


def fitted_optima(triplet: SweepTriplet, settings: Settings) -> FittedOptima:
    """Fits the method to a triplet.

    Args:
        triplet: The sweeps.
        settings: How to estimate; all points are used at once whatever they say.

    Raises:
        MnsfError: A sweep or a setting cannot be used, or a fit fails.
    """
    settings = settings.changed(
        {"warm_start.enabled": False, "fusion.inversion": True, "fusion.kind": "mlp"}
    )
    limit_threads(settings.compute)
    preparation = SweepPreparation(settings)
    run = EstimationRun(
        triplet=triplet,
        settings=settings,
        device=compute_device(settings.compute),
        preparation=preparation,
        warm_start=WarmStart(),
        cancelled=lambda: False,
    )
    forward_flow, *backward_flows = run.field_flows()
    fused_flow = run.fused_flow([forward_flow, *run.inverted_flows(backward_flows)])
    current, following = preparation.prepare(triplet.current, triplet.next)
    forward_field, backward_field = (field.network for field in run.learners.fields)
    fusion = run.learners.fusion.network
    whole = MultiFrameField(forward_field, backward_field, fusion, triplet.interval_ratio)

    def loss_with(field: nn.Module) -> Callable[[], torch.Tensor]:
        return lambda: following.distance.mean(current.points + field(current.points))

    losses = {
        "FNSF": (forward_field, loss_with(forward_field)),
        "MNSF (all weights)": (whole, loss_with(whole)),
        "MNSF (fusion)": (fusion, loss_with(whole)),
    }
    return FittedOptima(losses, run.finish(fused_flow).fits)
