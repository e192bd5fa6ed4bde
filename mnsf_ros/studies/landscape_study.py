# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The loss landscapes of FNSF and MNSF: is the optimum of fused flow a flatter one?

A step along a direction is measured in the size of the weights themselves ("filter normalization",
Li et al. 2018): every row of a weight matrix of the direction has the length of that row of the
optimum, and biases stay. Without that, networks of different scale could not be compared.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import pandas as pd
import torch
from numpy.typing import NDArray
from torch import nn

from mnsf_ros.core.compute_device import limit_threads
from mnsf_ros.core.flow_estimate import OptimizationResult, StopReason
from mnsf_ros.core.networks import invert_motion
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.drawing.charts import height_maps
from mnsf_ros.errors import SettingsError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.methods.mnsf import Networks, fitted_mnsf
from mnsf_ros.report.text_table import TextTable, format_number
from mnsf_ros.settings import Settings
from mnsf_ros.studies.study import StudyOptions, StudyResult
from mnsf_ros.sweeps.sweep import SweepTriplet

_TITLE: Final = "Loss landscape around the optimum"
_TEXT: Final = (
    "Mean distance D of the moved points to the next sweep, around the final weights of each "
    "method. Directions are random and filter-normalized: a step of 1 is as long as the weights "
    "themselves, layer by layer and row by row. FNSF varies the forward field; MNSF (all weights) "
    "both fields and the fusion; MNSF (fusion) the fusion alone, the last network to be optimized, "
    "while forward and backward flow are fixed. The rise is the mean of a step forth and back, "
    "over all directions, with the standard deviation between directions."
)

Loss = Callable[[], torch.Tensor]
# One tensor for each parameter of a network.
Direction = list[torch.Tensor]


def run(_name: str, options: StudyOptions) -> StudyResult:
    """Fits both methods to the first example and looks around their optima.

    Raises:
        MnsfError: A recording or a setting cannot be used, or a fit fails.
    """
    if options.evaluation.settings.ego_motion.removed:
        raise SettingsError(
            "ego_motion.removed is true, expected false: the landscape is that of networks in the "
            "sensor's frame"
        )
    example = options.first_example()
    options.say("fitting FNSF and MNSF")
    bench, networks = _fitted(example.triplet, options.evaluation.settings)
    found = {}
    for name, (network, loss_of) in _losses(bench, networks).items():
        options.say(f"looking around {name}")
        found[name] = landscape(network, loss_of, options)
    num_points = len(example.triplet.current.kept_xyz)
    where = f"Sweep {example.number} of {example.recording}, {num_points:,} points."
    texts = [_TEXT, where, *_unconverged(bench.fits)]
    return _result(found, texts, options.evaluation)


@dataclass(frozen=True, eq=False)
class Landscape:
    """The loss on a square around an optimum, and its rise along random directions.

    Attributes:
        axis: (G,) steps of the square, symmetric, 0 in the middle.
        losses_m: (G, G) loss, rows along the second direction.
        loss_m: Loss at the optimum.
        radii: (R,) lengths of steps along random directions.
        rises_m: (M, R) mean rise of the loss a step forth and back along each of M directions.
    """

    axis: NDArray[np.float64]
    losses_m: NDArray[np.float64]
    loss_m: float
    radii: NDArray[np.float64]
    rises_m: NDArray[np.float64]

    def numbers(self) -> pd.DataFrame:
        """Kind, step along the first and second direction, and loss in metres."""
        names = ("kind", "first_step", "second_step", "loss_m")
        first, second = (steps.ravel() for steps in np.meshgrid(self.axis, self.axis))
        parts: list[tuple[object, ...]] = [("square", first, second, self.losses_m.ravel())]
        for number, rises_m in enumerate(self.rises_m):
            line = np.zeros(len(self.radii))
            parts.append((f"direction {number}", self.radii, line, self.loss_m + rises_m))
        return pd.concat(pd.DataFrame(dict(zip(names, part, strict=True))) for part in parts)


def landscape(network: nn.Module, loss_of: Loss, options: StudyOptions) -> Landscape:
    """Measures the loss around the weights of a network."""
    case, generator = options.case, torch.Generator().manual_seed(options.evaluation.seed)
    pair = [random_direction(network, generator) for _ in range(2)]
    axis = np.linspace(-case.radius, case.radius, case.steps, dtype=np.float64)
    places = [(x, y) for y in axis for x in axis]
    losses_m = losses_along(network, loss_of, pair, places).reshape(len(axis), len(axis))
    radii = case.radius * np.array([0.1, 0.2, 0.5, 1.0])
    there_and_back = [(sign * step,) for step in radii for sign in (1.0, -1.0)]
    loss_m = float(losses_along(network, loss_of, [], [()])[0])
    rises_m = []
    for _ in range(case.directions):
        direction = random_direction(network, generator)
        losses = losses_along(network, loss_of, [direction], there_and_back)
        rises_m.append(losses.reshape(-1, 2).mean(axis=1) - loss_m)
    return Landscape(axis, losses_m, loss_m, radii, np.array(rises_m))


def random_direction(network: nn.Module, generator: torch.Generator) -> Direction:
    """Returns a filter-normalized random direction; the generator must be on the CPU."""
    return [_normalized(weights.detach(), generator) for weights in network.parameters()]


def _normalized(weights: torch.Tensor, generator: torch.Generator) -> torch.Tensor:
    if weights.ndim < 2:
        return torch.zeros_like(weights)
    drawn = torch.randn(weights.shape, generator=generator).to(weights.device)
    lengths = torch.linalg.vector_norm(weights.flatten(1), dim=1)
    drawn_lengths = torch.linalg.vector_norm(drawn.flatten(1), dim=1).clamp(min=1e-12)
    scales = (lengths / drawn_lengths).view(-1, *[1] * (weights.ndim - 1))
    normalized: torch.Tensor = drawn * scales
    return normalized


@torch.no_grad()
def losses_along(
    network: nn.Module,
    loss_of: Loss,
    directions: Sequence[Direction],
    places: Sequence[Sequence[float]],
) -> NDArray[np.float64]:
    """Returns the loss (S,) at S places, each one step along each of the directions.

    The network is at its optimum, and is left there.
    """
    weights = list(network.parameters())
    optimum = [item.clone() for item in weights]
    losses = []
    try:
        for place in places:
            for number, item in enumerate(weights):
                item.copy_(optimum[number])
                for step, direction in zip(place, directions, strict=True):
                    item.add_(direction[number], alpha=step)
            losses.append(float(loss_of()))
    finally:
        for item, before in zip(weights, optimum, strict=True):
            item.copy_(before)
    return np.array(losses)


def _fitted(triplet: SweepTriplet, settings: Settings) -> tuple[Workbench, Networks]:
    settings = settings.changed({"fusion.inversion": True, "fusion.kind": "mlp"})
    limit_threads(settings.compute)
    bench = Workbench(triplet, settings, {}, num_before=1)
    return bench, fitted_mnsf(bench)[1]


def _losses(bench: Workbench, networks: Networks) -> dict[str, tuple[nn.Module, Loss]]:
    """Name to network and loss, over all points at once."""
    points, target = bench.current.points, bench.next.distance
    forward_field, backward_field = networks.fields
    fusion = networks.fusion

    def fused_flow(points: torch.Tensor) -> torch.Tensor:
        inverted = invert_motion(backward_field(points), bench.triplet.interval_ratio)
        flow: torch.Tensor = fusion(torch.cat((forward_field(points), inverted), dim=1))
        return flow

    def loss_with(flow_of: Callable[[torch.Tensor], torch.Tensor]) -> Loss:
        return lambda: target.mean(points + flow_of(points))

    return {
        "FNSF": (forward_field, loss_with(forward_field)),
        "MNSF (all weights)": (
            nn.ModuleList([forward_field, backward_field, fusion]),
            loss_with(fused_flow),
        ),
        "MNSF (fusion)": (fusion, loss_with(fused_flow)),
    }


def _unconverged(fits: Mapping[str, OptimizationResult]) -> list[str]:
    cut_off = [
        f"{stage} ({fit.stop_reason.value.replace('_', ' ')} after {fit.iterations} steps)"
        for stage, fit in fits.items()
        if fit.stop_reason is not StopReason.CONVERGED
    ]
    if not cut_off:
        return []
    return [f"Note: not converged, so that no optimum is in the middle: {', '.join(cut_off)}."]


def _result(
    found: dict[str, Landscape], texts: list[str], evaluation: EvaluationOptions
) -> StudyResult:
    radii = next(iter(found.values())).radii
    header = ["method", "loss (m)", *(f"rise at {radius:g} (m)" for radius in radii)]
    cells, parts = [], []
    for name, item in found.items():
        pairs = zip(item.rises_m.mean(axis=0), item.rises_m.std(axis=0), strict=True)
        rises = (f"{mean:.4f} ± {deviation:.4f}" for mean, deviation in pairs)
        cells.append([name, format_number(item.loss_m, 4), *rises])
        parts.append(item.numbers().assign(method=name))
    numbers = pd.concat(parts)[["method", "kind", "first_step", "second_step", "loss_m"]]
    table = TextTable(header, cells, "Sharpness: rise of the loss")
    maps = {name: (item.axis, item.losses_m, item.loss_m) for name, item in found.items()}
    return StudyResult(_TITLE, texts, [table], numbers, height_maps(_TITLE, maps), evaluation)
