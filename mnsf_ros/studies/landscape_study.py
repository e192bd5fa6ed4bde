# Copyright 2026 The mnsf_ros developers. SPDX-License-Identifier: Apache-2.0
"""The loss landscapes of FNSF and MNSF: is the optimum of fused flow a flatter one?

A step along a direction is measured in the size of the weights themselves ("filter normalization",
Li et al. 2018): every row of a weight matrix of the direction has the length of that row of the
optimum, and biases stay. Without that, networks of different scale could not be compared.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Final

import numpy as np
import pandas as pd
import torch
from torch import nn

from mnsf_ros.arrays import Floats
from mnsf_ros.core.compute_device import limit_threads
from mnsf_ros.core.flow_estimate import OptimizationResult, StopReason
from mnsf_ros.drawing.charts import height_maps
from mnsf_ros.errors import SettingsError
from mnsf_ros.evaluation.options import EvaluationOptions
from mnsf_ros.methods.mnsf import Networks, fitted_mnsf
from mnsf_ros.networks.networks import invert_motion
from mnsf_ros.networks.workbench import Workbench
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

_SQUARE: Final = "square"
# Half width of the picture, in lengths of the weight vector, and grid points along each side.
_RADIUS: Final = 0.5
_NUM_STEPS: Final = 21

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


def landscape(network: nn.Module, loss_of: Loss, options: StudyOptions) -> pd.DataFrame:
    """Measures the loss around the weights of a network.

    Returns:
        Columns `kind`, `first_step`, `second_step` and `loss_m`. The kind `square` is a symmetric
        grid of steps along two random directions; `direction N` are steps along one, with the mean
        loss of a step forth and back.
    """
    generator = torch.Generator().manual_seed(options.evaluation.seed)
    lines: list[tuple[str, float, float, float]] = []
    pair = [random_direction(network, generator) for _ in range(2)]
    axis = np.linspace(-_RADIUS, _RADIUS, _NUM_STEPS)
    places = [(x, y) for y in axis for x in axis]
    for place, loss_m in zip(places, losses_along(network, loss_of, pair, places), strict=True):
        lines.append((_SQUARE, *place, loss_m))
    radii = _RADIUS * np.array([0.1, 0.2, 0.5, 1.0])
    there_and_back = [(sign * step,) for step in radii for sign in (1.0, -1.0)]
    for number in range(options.case.directions):
        direction = random_direction(network, generator)
        losses = losses_along(network, loss_of, [direction], there_and_back)
        for step, loss_m in zip(radii, losses.reshape(-1, 2).mean(axis=1), strict=True):
            lines.append((f"direction {number}", step, 0.0, loss_m))
    return pd.DataFrame(lines, columns=["kind", "first_step", "second_step", "loss_m"])


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
    return drawn * scales


@torch.no_grad()
def losses_along(
    network: nn.Module,
    loss_of: Loss,
    directions: Sequence[Direction],
    places: Sequence[Sequence[float]],
) -> Floats:
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
        return fusion(torch.cat((forward_field(points), inverted), dim=1))

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
    found: dict[str, pd.DataFrame], texts: list[str], evaluation: EvaluationOptions
) -> StudyResult:
    cells, maps = [], {}
    header = ["method", "loss (m)"]
    for name, numbers in found.items():
        square = numbers[numbers["kind"] == _SQUARE]
        maps[name] = square.pivot(index="second_step", columns="first_step", values="loss_m")
        loss_m = maps[name].at[0.0, 0.0]
        others = numbers[numbers["kind"] != _SQUARE]
        rises = (others["loss_m"] - loss_m).groupby(others["first_step"])
        header[2:] = [f"rise at {radius:g} (m)" for radius in rises.groups]
        pairs = zip(rises.mean(), rises.std(ddof=0), strict=True)
        texts_of_rises = (f"{mean:.4f} ± {deviation:.4f}" for mean, deviation in pairs)
        cells.append([name, format_number(loss_m, 4), *texts_of_rises])
    rows = pd.concat(numbers.assign(method=name) for name, numbers in found.items())
    rows = rows[["method", "kind", "first_step", "second_step", "loss_m"]]
    table = TextTable(header, cells, "Sharpness: rise of the loss")
    return StudyResult(_TITLE, texts, [table], rows, evaluation, height_maps(_TITLE, maps))
