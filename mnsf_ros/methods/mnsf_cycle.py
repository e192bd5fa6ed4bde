"""MNSF with NSFP's cycle term: each field has an inverse that must bring the points back."""

from __future__ import annotations

import torch
from torch import nn

from mnsf_ros.core.motion_inversion import invert_motion
from mnsf_ros.core.optimization import Learner
from mnsf_ros.core.prepared_sweep import PreparedSweep
from mnsf_ros.core.schedule import Schedule, Schedules
from mnsf_ros.core.temporal_fusion import fusion_network
from mnsf_ros.core.workbench import Workbench
from mnsf_ros.methods.fields import perceptron_field


def mnsf_cycle(bench: Workbench, schedules: Schedules) -> torch.Tensor:
    """MNSF (cycle consistency) of the paper's tables; (N, 3) metres."""
    (previous,) = bench.before
    forward_flow = _field_flow("forward", bench, bench.next, schedules.forward)
    backward_flow = _field_flow("backward", bench, previous, schedules.backward)
    inverted_flow = invert_motion(backward_flow, bench.triplet.interval_ratio)
    network = fusion_network(bench.settings.fusion, bench.generator).to(bench.device)
    fusion = Learner.fresh(network)
    return bench.fused_flow(fusion, [forward_flow, inverted_flow], schedules.fusion)


def _field_flow(
    stage: str, bench: Workbench, target: PreparedSweep, schedule: Schedule
) -> torch.Tensor:
    """Minimizes mean D(q, S) + w mean D(q + h(q), S2), with q = p + g(p); (N, 3) metres."""
    weight = bench.settings.mnsf_cycle.weight
    there, back = (perceptron_field(bench) for _ in range(2))

    def loss_of() -> torch.Tensor:
        points = bench.points.draw()
        moved = points + there(points)
        returned = moved + back(moved)
        return target.distance.mean(moved) + weight * bench.current.distance.mean(returned)

    bench.fit(stage, Learner.fresh(nn.ModuleList([there, back])), loss_of, schedule)
    return bench.flow(stage, there)
