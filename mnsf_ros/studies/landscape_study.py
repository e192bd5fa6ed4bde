"""The loss landscape of FNSF against that of MNSF: is the optimum of fused flow a flatter one?"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Final

import torch
from torch import nn

from mnsf_ros.core.compute_device import compute_device, limit_threads
from mnsf_ros.core.motion_inversion import invert_motion
from mnsf_ros.core.optimization import OptimizationResult, StopReason
from mnsf_ros.core.prepared_sweep import SweepPreparation
from mnsf_ros.core.scene_flow_estimator import never
from mnsf_ros.core.schedule import Schedules
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.drawing.study_charts import Heights, height_maps
from mnsf_ros.errors import SettingsError
from mnsf_ros.evaluation.errors import EvaluationError
from mnsf_ros.evaluation.run_start import check_folder
from mnsf_ros.evaluation.tables import TextTable, format_number
from mnsf_ros.methods.mnsf import mnsf
from mnsf_ros.settings import Settings
from mnsf_ros.studies.loss_landscape import Landscape, landscape
from mnsf_ros.studies.study import StudyOptions, StudyResult
from mnsf_ros.studies.study_examples import first_example
from mnsf_ros.sweeps.sweep import SweepTriplet

_TITLE: Final = "Loss landscape around the optimum"
_TEXT: Final = (
    "Mean distance D of the moved points to the next sweep, around the weights that each method "
    "ends with. Directions are random and filter-normalized: a step of 1 is as long as the weights "
    "themselves, layer by layer and row by row. FNSF varies the forward field; MNSF (all weights) "
    "both fields and the fusion; MNSF (fusion) the fusion alone, which is what is optimized at "
    "last, while forward and backward flow are fixed. The rise is the mean of a step forth and "
    "back, over all directions, with the standard deviation between directions."
)
# Ten times the weights themselves; far beyond, layer by layer, the loss is no number any more.
_MAX_RADIUS: Final = 10.0
# The optimum and a step to each side.
_MIN_STEPS: Final = 3
# One has no deviation between directions.
_MIN_DIRECTIONS: Final = 2


@dataclass(frozen=True)
class LandscapeOptions:
    """How to look at a landscape.

    Attributes:
        radius: The picture reaches so far to each side.
        num_steps: Steps from one side to the other, an odd number.
        num_directions: Random directions for the sharpness.
    """

    radius: float = 0.5
    num_steps: int = 21
    num_directions: int = 10

    def __post_init__(self) -> None:
        """Checks the values.

        Raises:
            EvaluationError: If a number is out of its range.
        """
        if not 0 < self.radius <= _MAX_RADIUS:
            raise EvaluationError(
                f"radius: got {self.radius:g}, expected more than 0, at most {_MAX_RADIUS:g}"
            )
        if self.num_steps < _MIN_STEPS or self.num_steps % 2 == 0:
            raise EvaluationError(
                f"steps: got {self.num_steps}, expected an odd number, {_MIN_STEPS} or more"
            )
        if self.num_directions < _MIN_DIRECTIONS:
            raise EvaluationError(
                f"directions: got {self.num_directions}, expected {_MIN_DIRECTIONS} or more"
            )


def run_landscape_study(options: StudyOptions, how: LandscapeOptions | None = None) -> StudyResult:
    """Fits both methods to the first example and looks around their optima.

    Raises:
        MnsfError: A recording, a setting or the folder cannot be used, or a fit fails.
    """
    how = how or LandscapeOptions()
    check_folder(options.out, resume=options.resume)
    if options.settings.ego_motion.removed:
        raise SettingsError(
            "ego_motion.removed is true, expected false: the landscape is that of networks in the "
            "sensor's frame"
        )
    example = first_example(options)
    options.say("fitting FNSF and MNSF")
    bench = fitted_workbench(example.triplet, options.evaluation().method_settings)
    found = {}
    for name, (network, loss_of) in _losses(bench).items():
        options.say(f"looking around {name}")
        found[name] = landscape(
            network,
            loss_of,
            seed=options.seed,
            radius=how.radius,
            num_steps=how.num_steps,
            num_directions=how.num_directions,
        )
    num_points = len(example.triplet.current.kept_xyz)
    where = f"Sweep {example.number} of {example.recording}, {num_points:,} points."
    return landscape_result(found, [_TEXT, where, *_unconverged(bench.fits)])


def fitted_workbench(triplet: SweepTriplet, settings: Settings) -> Workbench:
    """Returns a workbench on which MNSF, and with it FNSF, was fitted to a triplet.

    Raises:
        MnsfError: A sweep or a setting cannot be used, or a fit fails.
    """
    settings = settings.changed(
        {"warm_start.enabled": False, "fusion.inversion": True, "fusion.kind": "mlp"}
    )
    limit_threads(settings.compute)
    device, preparation = compute_device(settings.compute), SweepPreparation(settings)
    bench = Workbench(triplet, settings, device, preparation, num_before=1)
    mnsf(bench, Schedules.start_now(settings, is_warm=False, cancelled=never))
    return bench


class MultiFrameField(nn.Module):
    """MNSF as one network: (M, 3) points to their fused flow, (M, 3) metres."""

    def __init__(self, bench: Workbench) -> None:
        """Takes the fitted networks."""
        super().__init__()
        self._forward_field, self._backward_field = (
            field.network for field in bench.learners.fields
        )
        self._fusion = bench.learners.fusion.network
        self._ratio = bench.triplet.interval_ratio

    def forward(self, points: torch.Tensor) -> torch.Tensor:
        """Flow at the points."""
        backward_flow = self._backward_field(points)
        flows = (self._forward_field(points), invert_motion(backward_flow, self._ratio))
        fused: torch.Tensor = self._fusion(torch.cat(flows, dim=1))
        return fused


def _losses(bench: Workbench) -> dict[str, tuple[nn.Module, Callable[[], torch.Tensor]]]:
    """What is varied to its weights and their loss, over all points at once."""
    points, target = bench.current.points, bench.next.distance
    forward_field, whole = bench.learners.forward.network, MultiFrameField(bench)

    def loss_with(field: nn.Module) -> Callable[[], torch.Tensor]:
        return lambda: target.mean(points + field(points))

    return {
        "FNSF": (forward_field, loss_with(forward_field)),
        "MNSF (all weights)": (whole, loss_with(whole)),
        "MNSF (fusion)": (bench.learners.fusion.network, loss_with(whole)),
    }


def _unconverged(fits: Mapping[str, OptimizationResult]) -> list[str]:
    """A note on the fits that ended before they converged."""
    cut_off = [
        f"{stage} ({fit.stop_reason.value.replace('_', ' ')} after {fit.iterations} steps)"
        for stage, fit in fits.items()
        if fit.stop_reason is not StopReason.CONVERGED
    ]
    if not cut_off:
        return []
    return [f"Note: not converged, so that no optimum is in the middle: {', '.join(cut_off)}."]


def landscape_result(found: dict[str, Landscape], texts: list[str]) -> StudyResult:
    """Puts landscapes into a table, rows and a picture."""
    radii = next(iter(found.values())).radii
    header = ["method", "loss (m)", *(f"rise at {radius:g} (m)" for radius in radii)]
    cells = [
        [
            name,
            format_number(item.loss_m, 4),
            *(
                f"{mean:.4f} ± {deviation:.4f}"
                for mean, deviation in zip(item.sharpness, item.rises_m.std(axis=0), strict=True)
            ),
        ]
        for name, item in found.items()
    ]
    rows = [
        (name, "square", x, y, item.losses_m[row, column])
        for name, item in found.items()
        for row, y in enumerate(item.axis)
        for column, x in enumerate(item.axis)
    ]
    rows += [
        (name, f"direction {number}", radius, 0.0, item.loss_m + item.rises_m[number, column])
        for name, item in found.items()
        for number in range(len(item.rises_m))
        for column, radius in enumerate(item.radii)
    ]
    return StudyResult(
        name="landscape",
        title=_TITLE,
        texts=texts,
        tables=[TextTable(header, cells, "Sharpness: how much the loss rises")],
        header=("method", "kind", "first_step", "second_step", "loss_m"),
        rows=rows,
        picture=height_maps(
            _TITLE,
            "m",
            {name: Heights(item.axis, item.losses_m, item.loss_m) for name, item in found.items()},
        ),
    )
